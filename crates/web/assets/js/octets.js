// Octets in rows, numbered from 1 as manuals count them, tied to sentences: pointing at one shows the other.

import { h } from "./dom.js";

/**
 * A grid of octets. `link(first, last, element)` ties an element to a range of octets; a click on either holds the
 * mark until the next click.
 */
export function makeOctets(label, perRow = 16) {
  const grid = h("div", { class: "octets", role: "group", "aria-label": label });
  let cells = [];
  let links = [];
  let shown = null;
  let held = null;

  function show(text) {
    if (text === shown) return;
    const octets = text.trim() ? text.trim().split(/\s+/) : [];
    if (shown !== null && octets.length === cells.length) {
      octets.forEach((octet, i) => {
        if (cells[i].textContent !== octet) {
          cells[i].textContent = octet;
          flash(cells[i]);
        }
      });
    } else {
      grid.replaceChildren();
      cells = octets.map((octet, i) => {
        if (i % perRow === 0) grid.append(h("span", { class: "row-number", "aria-hidden": "true" }, String(i + 1)));
        const cell = h("button", { type: "button", class: "octet", tabindex: -1, title: `Octet ${i + 1}`,
          onpointerenter: () => mark(linkAt(i + 1)), onpointerleave: () => mark(held),
          onclick: () => hold(linkAt(i + 1)) }, octet);
        grid.append(cell);
        return cell;
      });
    }
    shown = text;
  }

  const linkAt = (number) => {
    const here = links.filter(({ first, last }) => number >= first && number <= last);
    return here.sort((a, b) => (a.last - a.first) - (b.last - b.first))[0] ?? null;
  };

  function mark(link) {
    cells.forEach((cell, i) => cell.classList.toggle("marked", !!link && i + 1 >= link.first && i + 1 <= link.last));
    for (const each of links) each.element.classList.toggle("marked", each === link || (!!link && each.first === link.first && each.last === link.last));
  }

  function hold(link) {
    held = held === link ? null : link;
    mark(held);
    held?.element.scrollIntoView({ block: "nearest" });
  }

  function unlink() {
    links = [];
    held = null;
    mark(null);
  }

  function link(first, last, element) {
    const one = { first, last, element };
    links.push(one);
    cells.slice(first - 1, last).forEach((cell) => cell.classList.add("known"));
    element.addEventListener("pointerenter", () => mark(one));
    element.addEventListener("pointerleave", () => mark(held));
    element.addEventListener("focus", () => mark(one));
    element.addEventListener("blur", () => mark(held));
    element.addEventListener("click", () => hold(one));
    return one;
  }
  return { element: grid, show, link, unlink };
}

function flash(cell) {
  cell.classList.remove("changed");
  void cell.offsetWidth; // begins the animation anew
  cell.classList.add("changed");
}
