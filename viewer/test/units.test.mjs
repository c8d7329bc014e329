import assert from "node:assert/strict";
import { test } from "node:test";

import { load } from "./load.mjs";
import { contact, RADIUS_M, scene, squareScene } from "./skin.mjs";

const { colourTable, TABLE_SIZE, tableEntry } = await load("colours");
const { decode } = await load("decode");
const { AutoRange, roundUp } = await load("range");
const { Flat } = await load("flat");
const { contactForm, LEAST_RADIUS_M, pointOnSkin } = await load("form");
const { makeRaster } = await load("raster");
const { Slots } = await load("colour_slots");
const { formText, ohms } = await load("format");
const { Presser } = await load("press");
const { VertexValues } = await load("skin");

const linear = (byte) => (byte <= 10.31 ? byte / 255 / 12.92 : ((byte / 255 + 0.055) / 1.055) ** 2.4);
// What people without red or green cones see of linear sRGB: Viénot, Brettel and Mollon (1999),
// doi 10.1002/(SICI)1520-6378(199908)24:4<243::AID-COL5>3.0.CO;2-3.
const SIGHT = {
  everyone: [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
  protanope: [[0.11238, 0.88762, 0], [0.11238, 0.88762, 0], [0.00401, -0.00401, 1]],
  deuteranope: [[0.29275, 0.70725, 0], [0.29275, 0.70725, 0], [-0.02234, 0.02234, 1]],
};

/** CIE lightness of an entry as some eyes see it; the sum over channels weighs them as luminance does. */
function lightness(table, entry, eyes) {
  const rgb = [0, 1, 2].map((channel) => linear(table[4 * entry + channel]));
  const seen = SIGHT[eyes].map((row) => row.reduce((sum, weight, k) => sum + weight * rgb[k], 0));
  const luminance = 0.2126 * seen[0] + 0.7152 * seen[1] + 0.0722 * seen[2];
  return 116 * Math.cbrt(Math.max(luminance, 0)) - 16;
}

for (const theme of ["light", "dark"])
  for (const eyes of Object.keys(SIGHT))
    test(`colours: each arm of the ${theme} map goes evenly one way for ${eyes}`, () => {
      const table = colourTable(theme, true);
      const middle = TABLE_SIZE / 2;
      for (const direction of [1, -1]) {
        const steps = [];
        for (let k = 0; k < 8; k += 1) {
          const at = (share) => middle + (direction > 0 ? 0 : -1) + direction * Math.round(share * (middle - 1));
          steps.push(lightness(table, at((k + 1) / 8), eyes) - lightness(table, at(k / 8), eyes));
        }
        const sign = theme === "light" ? -1 : 1;
        const mean = steps.reduce((a, b) => a + b) / 8;
        assert.ok(sign * mean > 4, `an arm spans ${8 * mean} of 100`);
        // OKLab's lightness is not quite CIE's, and colour-blind eyes weigh hues otherwise: within two thirds of the mean.
        for (const step of steps) assert.ok(Math.abs(step - mean) < 0.67 * Math.abs(mean), `steps ${steps.map((s) => s.toFixed(1))}`);
      }
    });

test("colours: the two arms differ in hue for all eyes", () => {
  const table = colourTable("light", true);
  for (const eyes of Object.keys(SIGHT))
    for (const share of [0.3, 0.6, 1]) {
      const [warm, cold] = [share, -share].map((value) => {
        const entry = tableEntry(value, 1);
        const rgb = [0, 1, 2].map((channel) => linear(table[4 * entry + channel]));
        return SIGHT[eyes].map((row) => row.reduce((sum, weight, k) => sum + weight * rgb[k], 0));
      });
      assert.ok(warm[1] > 1.5 * warm[2] && cold[2] > 1.2 * cold[1], `${eyes} at ${share}: ${warm} and ${cold}`);
    }
});

test("colours: a quantity without a sign keeps its negative half grey", () => {
  const table = colourTable("dark", false);
  assert.deepEqual([...table.slice(0, 4)], [...table.slice(4 * (TABLE_SIZE / 2 - 1), 2 * TABLE_SIZE)]);
  assert.notDeepEqual([...table.slice(0, 3)], [...table.slice(-4, -1)]);
});

function packed(header, values) {
  const text = new TextEncoder().encode(header);
  const bytes = new Uint8Array(4 + text.length + 4 * values.length);
  const view = new DataView(bytes.buffer);
  view.setUint32(0, text.length, true);
  bytes.set(text, 4);
  values.forEach((value, k) => view.setFloat32(4 + text.length + 4 * k, value, true));
  return bytes.buffer;
}

test("decode: header and image come out; a message of another length does not", () => {
  const message = packed('{"sequence":7,"contacts":[]}', [0.5, -2]);
  const { header, values } = decode(message, 2);
  assert.equal(header.sequence, 7);
  assert.deepEqual([...values], [0.5, -2]);
  assert.equal(values.buffer, message);
  assert.throws(() => decode(message, 3), /3 pixels/);
  assert.throws(() => decode(new ArrayBuffer(2), 0), /2 bytes/);
  assert.throws(() => decode(packed('{"a":1} .', [1]), 1), /header of 9/);
});

test("range: round tops", () => {
  for (const [value, top] of [[0.9, 1], [1, 1], [1.01, 1.5], [4, 5], [7.1, 10], [0.0021, 0.003], [0, 1]]) assert.ok(Math.abs(roundUp(value) - top) < 1e-12, `${value}: ${roundUp(value)}`);
});

test("range: up at once, down slowly, noise at rest stays pale", () => {
  const range = new AutoRange("change");
  const feed = (seconds, largest, touched) => {
    for (let k = 0; k < 60 * seconds; k += 1) range.update(largest, touched, 1 / 60);
  };
  feed(5, 0.002, false);
  assert.ok(0.002 / range.value < 0.1001, `noise fills ${0.002 / range.value} of the range`);
  feed(0.5, 0.09, true);
  assert.equal(range.top, 0.1);
  assert.ok(Math.abs(range.value - 0.1) < 0.01);
  feed(1, 0.002, false);
  assert.ok(range.top >= 0.07, `after a second the top is ${range.top}`);
  feed(60, 0.002, false);
  assert.ok(range.top <= 0.03 && range.top >= 0.02, `after a minute the top is ${range.top}`);
});

test("range: touches that hardly rise above a loud image still get colour", () => {
  const range = new AutoRange("change");
  for (let k = 0; k < 300; k += 1) range.update(0.02, false, 1 / 60);
  for (let k = 0; k < 300; k += 1) range.update(0.08, true, 1 / 60);
  for (let k = 0; k < 6000; k += 1) range.update(0.02, false, 1 / 60);
  assert.ok(range.top <= 0.1, `the top is ${range.top}`);
});

test("flat: a cylinder there and back, and round the seam", () => {
  const cylinder = scene();
  const flat = new Flat(cylinder, cylinder.unrolled);
  for (const place of [[0.01, 0.02], [0.15, 0.29], [0.2996, 0]]) {
    const [u, v] = flat.fromSpace(flat.toSpace(place));
    assert.ok(Math.hypot(u - place[0], v - place[1]) < 1e-9);
  }
  const [x, y, z] = flat.toSpace([RADIUS_M * 0.5 * Math.PI, 0.1]);
  assert.ok(Math.hypot(x, y - RADIUS_M, z - 0.1) < 1e-9);
  assert.ok(Math.abs(flat.wrapped([-0.01, 0])[0] - (flat.size[0] - 0.01)) < 1e-12);
  assert.equal(flat.toSpace([0.1, 0.31]), null);
});

test("flat: a plane's picture lies round the middle of its vertices", () => {
  const { scene: square } = squareScene();
  const flat = new Flat(square, square.unrolled);
  assert.deepEqual(flat.origin, [-0.1, -0.1]);
  assert.deepEqual(flat.toSpace([-0.05, 0.02]), [-0.05, 0.02, 0]);
  assert.equal(flat.toSpace([0.11, 0]), null);
  assert.deepEqual(flat.clamped([0.3, -0.3]), [0.1, -0.1]);
});

test("flat: a vector of the skin keeps its direction, on a cylinder and on a plane", () => {
  const step = 1e-6;
  for (const body of [scene(), squareScene().scene]) {
    const flat = new Flat(body, body.unrolled);
    for (const [place, along] of [[[0.02, 0.05], [0.6, 0.8]], [[0.05, 0.03], [-0.8, 0.6]]]) {
      const [from, to] = [place, [place[0] + step * along[0], place[1] + step * along[1]]].map((at) => flat.toSpace(at));
      const vector = flat.vectorFromSpace(from, from.map((value, axis) => (to[axis] - value) / step));
      // Half the square of the step over the radius is what the chord leaves out.
      assert.ok(Math.hypot(vector[0] - along[0], vector[1] - along[1]) < 1e-4, `${vector}`);
    }
  }
});

const oblong = { halfLengthM: 0.0185, halfWidthM: 0.007, angle: 0.7 };
test("form: known only with its direction and both sizes", () => {
  const known = contact(1, { theta: 2, z: 0.1, force: 1, form: oblong }, 0);
  const form = contactForm(known);
  assert.deepEqual([form.halfLengthM, form.halfWidthM], [0.0185, 0.007]);
  const { normal } = known;
  const turned = [0, 1, 2].map((k) => normal[(k + 1) % 3] * form.along[(k + 2) % 3] - normal[(k + 2) % 3] * form.along[(k + 1) % 3]);
  assert.ok(Math.hypot(...form.across.map((value, k) => value - turned[k])) < 1e-12);
  for (const unknown of [{ direction: [null, null, null] }, { direction: [1, 0, null] }, { half_length_m: null }, { half_width_m: null }])
    assert.equal(contactForm({ ...known, ...unknown }), null);
  assert.equal(contactForm({ ...known, half_width_m: 0.0001 }).halfWidthM, LEAST_RADIUS_M);
});

test("form: on a cylinder its points are those of the layout, on a plane those of the tangent plane", () => {
  const body = scene();
  const flat = new Flat(body, body.unrolled);
  const [theta, z] = [2, 0.1];
  const middle = contact(1, { theta, z, force: 1, form: oblong }, 0);
  const form = contactForm(middle);
  for (const [along, across] of [[0.03, 0], [0, -0.02], [-0.04, 0.03]]) {
    const local = pointOnSkin(form, body.surface, [along, across, 0]);
    const point = [0, 1, 2].map((k) => middle.position_m[k] + local[0] * form.along[k] + local[1] * form.across[k] + local[2] * middle.normal[k]);
    const [cos, sin] = [Math.cos(oblong.angle), Math.sin(oblong.angle)];
    const expected = flat.toSpace([RADIUS_M * theta + along * cos - across * sin, z + along * sin + across * cos]);
    assert.ok(Math.hypot(...point.map((value, k) => value - expected[k])) < 1e-12, `${point} is not ${expected}`);
    for (const kind of ["plane", "free"]) assert.deepEqual(pointOnSkin(form, { kind }, [along, across, 0.001]), [along, across, 0.001]);
  }
  const [x, y, out] = pointOnSkin(form, body.surface, [0, 0, 0.001]);
  assert.ok(Math.hypot(x, y, out - 0.001) < 1e-12);
});

test("format: length and width of a contact in millimetres", () => {
  const touch = { theta: 2, z: 0.1, force: 1 };
  assert.equal(formText(contact(1, { ...touch, form: oblong }, 0)), "37 × 14 mm");
  assert.equal(formText(contact(1, touch, 0)), "");
});

function painted(body, image) {
  const flat = new Flat(body, body.unrolled);
  const raster = makeRaster(body, flat);
  const vertices = new VertexValues(body.skin);
  vertices.update(image);
  const texels = new Uint32Array(raster.width * raster.height);
  const table = Uint32Array.from({ length: TABLE_SIZE }, (_, k) => k + 1);
  raster.paint(texels, image, vertices.values, table, 1);
  return { raster, texels, at: (column, rowFromTop) => texels[rowFromTop * raster.width + column] };
}

test("raster: the first row of a grid lies at the bottom", () => {
  const body = scene();
  const image = new Float32Array(900);
  image[0] = 1;
  image[31] = -1;
  const { raster, at } = painted(body, image);
  assert.deepEqual([raster.width, raster.height], [30, 30]);
  assert.equal(at(0, 29), TABLE_SIZE);
  assert.equal(at(1, 28), 1);
  assert.equal(at(0, 0), TABLE_SIZE / 2 + 1);
});

test("raster: cells of a mesh without a grid are found where they lie", () => {
  const { scene: body, middles } = squareScene();
  const image = Float32Array.from(middles, ([x, y]) => (x > 0 && y > 0 ? 1 : 0));
  const { raster, texels, at } = painted(body, image);
  assert.equal(texels.filter((texel) => texel === 0).length, 0, "every texel is covered");
  const [w, h] = [raster.width, raster.height];
  assert.equal(at(w - 5, 5), TABLE_SIZE);
  for (const [column, row] of [[5, 5], [5, h - 5], [w - 5, h - 5]]) assert.equal(at(column, row), TABLE_SIZE / 2 + 1);
});

test("colour slots: a contact keeps its colour while others come and go", () => {
  const slots = new Slots();
  const assign = (...ids) => slots.assign(ids.map((id) => ({ id })));
  const [first] = assign(4);
  const [, second] = assign(4, 9);
  assert.notEqual(first, second);
  assert.deepEqual(assign(9), [second]);
  assert.notEqual(assign(9, 10)[1], second);
  const many = assign(...Array.from({ length: 12 }, (_, k) => 20 + k));
  assert.equal(new Set(many.slice(0, 8)).size, 8);
});

test("press: each touch gets the lowest free number, and a change is sent once", () => {
  const sent = [];
  let force = 2;
  const presser = new Presser((command) => (sent.push(command), true), () => force);
  const take = () => sent.splice(0).map((command) => [command.do, command.finger, command.force_n]);
  presser.down("a", [0, 0, 0]);
  presser.down("b", [0, 0, 1]);
  assert.deepEqual(take(), [["press", 0, 2], ["press", 1, 2]]);
  presser.flush();
  assert.deepEqual(take(), []);
  presser.move("b", [0, 0, 2]);
  presser.move("b", [0, 0, 3]);
  presser.flush();
  assert.deepEqual(sent.splice(0), [{ do: "press", finger: 1, position_m: [0, 0, 3], force_n: 2 }]);
  force = 3;
  presser.flush();
  assert.deepEqual(take(), [["press", 0, 3], ["press", 1, 3]]);
  presser.up("a");
  presser.down("c", [0, 0, 4]);
  assert.deepEqual(take(), [["release", 0, undefined], ["press", 0, 3]]);
  presser.upAll();
  assert.deepEqual(take().map(([what]) => what), ["release", "release"]);
});

test("press: a kept touch stays until it is pressed again or all end", () => {
  const sent = [];
  const presser = new Presser((command) => (sent.push(command), true), () => 2);
  const take = () => sent.splice(0).map((command) => [command.do, command.finger]);
  presser.down("a", [0, 0, 0]);
  presser.keep("a");
  presser.up("a");
  presser.upAll();
  presser.down("a", [0, 0, 1]);
  assert.deepEqual(take(), [["press", 0], ["press", 1]]);
  assert.equal(presser.count, 2);
  assert.ok(!presser.releaseAt([0, 0, 1]), "a touch that is held is not let go by another");
  assert.ok(!presser.releaseAt([0, 0, 0.5]) && presser.releaseAt([0, 0.005, 0]));
  assert.deepEqual(take(), [["release", 0]]);
  presser.keep("a");
  presser.releaseAll();
  assert.deepEqual(take(), [["release", 1]]);
  assert.equal(presser.count, 0);
});

test("format: a resistance has two or three digits, and six characters at most", () => {
  const cases = [[0, "0 Ω"], [0.00001, "0 Ω"], [0.0039, "3.9 mΩ"], [0.99, "990 mΩ"], [0.999, "999 mΩ"], [1, "1.0 Ω"], [4.27, "4.3 Ω"], [99.7, "100 Ω"], [310.5, "311 Ω"], [999.7, "1.0 kΩ"], [5432, "5.4 kΩ"], [81234, "81 kΩ"], [999900, "1.0 MΩ"], [1.23e6, "1.2 MΩ"], [null, "–"]];
  for (const [value, text] of cases) {
    assert.equal(ohms(value), text, `${value}`);
    assert.ok(text.length <= 6);
  }
});
