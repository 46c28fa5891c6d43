// Starts `taskspec lsp` for YAML files; which of them are tasks is for the server to find out.
"use strict";

const vscode = require("vscode");
const { LanguageClient } = require("vscode-languageclient/node");

/** @type {LanguageClient | undefined} */
let client;

async function start() {
  const [command, ...args] = vscode.workspace.getConfiguration("taskspec").get("command");
  const server = { command, args };
  client = new LanguageClient("taskspec", "taskspec", server, {
    documentSelector: [{ scheme: "file", language: "yaml" }],
  });
  try {
    await client.start();
  } catch (error) {
    client = undefined;
    vscode.window.showErrorMessage(
      `taskspec: cannot start "${[command, ...args].join(" ")}": ${error.message}. ` +
        "Install it by pip install 'taskspec-robotics[editor]', or set taskspec.command.",
    );
  }
}

async function activate(context) {
  const restart = vscode.commands.registerCommand("taskspec.restart", async () => {
    await deactivate();
    await start();
  });
  context.subscriptions.push(restart);
  await start();
}

async function deactivate() {
  const running = client;
  client = undefined;
  await running?.stop();
}

module.exports = { activate, deactivate };
