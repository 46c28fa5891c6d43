/* What a button copies. */

async function copy(button, text) {
  try {
    await navigator.clipboard.writeText(text);
  } catch {
    // Where a page may not use the clipboard, a selection can still be copied.
    const field = document.createElement("textarea");
    field.value = text;
    button.after(field);
    field.select();
    document.execCommand("copy");
    field.remove();
  }
  button.textContent = "copied";
  setTimeout(() => { button.textContent = "copy"; }, 1500);
}

/* Beside what it copies stands a button of its own. */
for (const b of document.querySelectorAll("[data-copy]")) b.addEventListener("click", () => copy(b, b.nextElementSibling.textContent));
