// What is in a board's image: bytes of flash, and whether anything allocates.
//   node elf.mjs IMAGE.elf [IMAGE.elf ...]

import { readFileSync } from 'node:fs';

/** The greatest size of an image in flash, bytes. */
const MAX_FLASH = 96 * 1024;
const ALLOCATORS = /\b(__rust_alloc|__rust_realloc|__rg_alloc|malloc|calloc|realloc|_sbrk)\b/;

/** Loadable segments and names of symbols of an ELF file with 32-bit words. */
export function readElf(path) {
  const elf = readFileSync(path);
  if (elf.toString('latin1', 0, 4) !== '\x7fELF' || elf[4] !== 1) throw new Error(`${path} is no 32-bit ELF file`);
  const table = (at, size, count, read) => Array.from({ length: count }, (_, index) => read(at + index * size));
  const word = (at) => elf.readUInt32LE(at);
  const segments = table(word(28), elf.readUInt16LE(42), elf.readUInt16LE(44), (at) => ({
    type: word(at), offset: word(at + 4), address: word(at + 12), bytes: word(at + 16),
  })).filter(({ type, bytes }) => type === 1 && bytes > 0);
  const sections = table(word(32), elf.readUInt16LE(46), elf.readUInt16LE(48), (at) => ({
    type: word(at + 4), offset: word(at + 16), bytes: word(at + 20), link: word(at + 24),
  }));
  const symbols = sections.filter(({ type }) => type === 2).flatMap(({ offset, bytes, link }) =>
    table(offset, 16, bytes / 16, (at) => {
      const begin = sections[link].offset + word(at);
      return elf.toString('latin1', begin, elf.indexOf(0, begin));
    }),
  );
  return { elf, segments, symbols };
}

if (process.argv[1] === new URL(import.meta.url).pathname) {
  let failed = false;
  for (const path of process.argv.slice(2)) {
    const { segments, symbols } = readElf(path);
    const flash = segments.reduce((sum, { bytes }) => sum + bytes, 0);
    const allocators = symbols.filter((symbol) => ALLOCATORS.test(symbol));
    if (symbols.length === 0) throw new Error(`${path} has no symbols: nothing can be said of its allocator`);
    console.log(`${path.split('/').at(-1)}: ${flash} bytes of flash of at most ${MAX_FLASH}, ${symbols.length} symbols, ${allocators.length} of an allocator`);
    failed ||= flash > MAX_FLASH || allocators.length > 0;
  }
  process.exit(failed ? 1 : 0);
}
