// Serves the page with two wandering touches, to look at it: node test/demo.mjs [port]

import { startServer } from "./server.mjs";

const wander = (t) => [
  { theta: 0.8 + 0.5 * t, z: 0.15 + 0.08 * Math.sin(0.7 * t), force: 1.6 + Math.sin(t) },
  ...(t % 10 > 4 ? [{ theta: 2.6, z: 0.08, force: 1.2 }] : []),
];
const { address } = await startServer({ port: Number(process.argv[2] ?? 8040), touches: wander });
console.log(address);
