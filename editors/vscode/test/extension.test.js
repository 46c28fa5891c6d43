// Activation with stand-ins for what VS Code and its client library bring: `node --test`.
"use strict";

const assert = require("node:assert");
const Module = require("node:module");
const path = require("node:path");
const { beforeEach, test } = require("node:test");

const told = { commands: {}, errors: [], clients: [], command: ["taskspec", "lsp"], fails: false };

class LanguageClient {
  constructor(id, name, server, options) {
    Object.assign(this, { id, name, server, options, state: "new" });
    told.clients.push(this);
  }
  async start() {
    if (told.fails) throw new Error("spawn ENOENT");
    this.state = "running";
  }
  async stop() {
    this.state = "stopped";
  }
}

const stands = {
  vscode: {
    workspace: { getConfiguration: (section) => ({ get: (key) => ({ "taskspec.command": told.command })[`${section}.${key}`] }) },
    window: { showErrorMessage: (text) => told.errors.push(text) },
    commands: {
      registerCommand: (name, run) => {
        told.commands[name] = run;
        return { dispose: () => delete told.commands[name] };
      },
    },
  },
  "vscode-languageclient/node": { LanguageClient },
};
const load = Module._load;
Module._load = (name, ...rest) => stands[name] ?? load(name, ...rest);

const { main } = require("../package.json");
const { activate, deactivate } = require(path.join("..", main));

beforeEach(async () => {
  await deactivate();
  Object.assign(told, { commands: {}, errors: [], clients: [], command: ["taskspec", "lsp"], fails: false });
});

test("activation starts the configured command for YAML files", async () => {
  told.command = [".venv/bin/taskspec", "lsp"];
  const context = { subscriptions: [] };
  await activate(context);
  assert.deepStrictEqual(Object.keys(told.commands), ["taskspec.restart"]);
  assert.strictEqual(context.subscriptions.length, 1);
  assert.strictEqual(told.clients.length, 1);
  const [client] = told.clients;
  assert.deepStrictEqual(client.server, { command: ".venv/bin/taskspec", args: ["lsp"] });
  assert.deepStrictEqual(client.options.documentSelector, [{ scheme: "file", language: "yaml" }]);
  assert.strictEqual(client.state, "running");
  assert.deepStrictEqual(told.errors, []);
});

test("a restart stops the server and starts another with the command of now", async () => {
  await activate({ subscriptions: [] });
  told.command = ["other", "lsp"];
  await told.commands["taskspec.restart"]();
  assert.deepStrictEqual(told.clients.map((client) => client.state), ["stopped", "running"]);
  assert.strictEqual(told.clients[1].server.command, "other");
});

test("a command that does not start is named, and a restart tries again", async () => {
  told.fails = true;
  await activate({ subscriptions: [] });
  assert.match(told.errors[0], /cannot start "taskspec lsp": spawn ENOENT.*pip install/);
  told.fails = false;
  await told.commands["taskspec.restart"]();
  assert.strictEqual(told.clients.at(-1).state, "running");
});

test("deactivation stops the server", async () => {
  await activate({ subscriptions: [] });
  await deactivate();
  assert.strictEqual(told.clients[0].state, "stopped");
});
