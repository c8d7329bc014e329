// A table between two marks of a page of the book.

import { readFileSync, renameSync, writeFileSync } from "node:fs";

/** Puts a table into a page in the place of the one between `<!-- NAME -->` and `<!-- end of NAME -->`. */
export function replaceTable(path, name, table) {
  const text = readFileSync(path, "utf8");
  const [begin, end] = [`<!-- ${name} -->\n`, `<!-- end of ${name} -->`];
  const from = text.indexOf(begin) + begin.length;
  const to = text.indexOf(end);
  if (from < begin.length || to < from) throw new Error(`${path} has no place for the table`);
  writeFileSync(`${path}.new`, text.slice(0, from) + table + text.slice(to));
  renameSync(`${path}.new`, path);
}
