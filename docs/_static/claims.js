// Buttons above a table of verdicts that show only the statements of one verdict; without a script all are shown.
document.addEventListener("DOMContentLoaded", () => {
  for (const table of document.querySelectorAll("article table")) {
    const column = [...table.querySelectorAll("thead th")].findIndex((cell) => cell.textContent.trim() === "verdict");
    const rows = [...table.querySelectorAll("tbody tr")];
    if (column < 0 || rows.length < 10) continue;
    const verdict = (row) => row.cells[column].textContent.trim();
    const buttons = document.createElement("div");
    buttons.className = "verdicts";
    for (const word of ["all", ...new Set(rows.map(verdict))]) {
      const shown = rows.filter((row) => word === "all" || verdict(row) === word);
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = `${word} (${shown.length})`;
      button.setAttribute("aria-pressed", word === "all");
      button.addEventListener("click", () => {
        for (const row of rows) row.hidden = !shown.includes(row);
        for (const other of buttons.children) other.setAttribute("aria-pressed", other === button);
      });
      buttons.append(button);
    }
    table.before(buttons);
  }
});
