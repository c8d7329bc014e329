// The simulated skin of the tests: the paper's cylinder, its electrodes, touches as Gaussian bumps, and a little noise.

export const RADIUS_M = 0.0477;
export const LENGTH_M = 0.3;
export const ROWS = 30;
export const COLUMNS = 30;
const WIDTH_M = 2 * Math.PI * RADIUS_M;
const AROUND = 60;
const ALONG = 60;
/** Width of a touch in the image, m. */
const SPREAD_M = 0.014;

export const onCylinder = (theta, z) => [RADIUS_M * Math.cos(theta), RADIUS_M * Math.sin(theta), z];
export const thetaOf = ([x, y]) => (Math.atan2(y, x) + 2 * Math.PI) % (2 * Math.PI);
const outward = (theta) => [Math.cos(theta), Math.sin(theta), 0];

export function electrodes() {
  const places = [];
  for (let ring = 0; ring < 6; ring += 1)
    for (let k = 0; k < 5; k += 1) places.push({ theta: (k + 0.5 * (ring % 2)) * 0.4 * Math.PI, z: 0.06 * ring });
  return places;
}

function mesh() {
  const [vertices, normals, triangles, pixels, weights] = [[], [], [], [], []];
  for (let j = 0; j <= ALONG; j += 1)
    for (let i = 0; i < AROUND; i += 1) {
      const theta = (i / AROUND) * 2 * Math.PI;
      const z = (j / ALONG) * LENGTH_M;
      vertices.push(...onCylinder(theta, z));
      normals.push(...outward(theta));
      // Bilinear between the centres of the pixels, round the seam, and level beyond the outer centres.
      const column = (i / AROUND) * COLUMNS - 0.5;
      const row = Math.min(Math.max((j / ALONG) * ROWS - 0.5, 0), ROWS - 1);
      const [left, low] = [Math.floor(column), Math.min(Math.floor(row), ROWS - 2)];
      const [s, t] = [column - left, row - low];
      const pixel = (r, c) => r * COLUMNS + ((c + COLUMNS) % COLUMNS);
      pixels.push(pixel(low, left), pixel(low, left + 1), pixel(low + 1, left), pixel(low + 1, left + 1));
      weights.push((1 - s) * (1 - t), s * (1 - t), (1 - s) * t, s * t);
    }
  for (let j = 0; j < ALONG; j += 1)
    for (let i = 0; i < AROUND; i += 1) {
      const next = (i + 1) % AROUND;
      const [a, b, c, d] = [j * AROUND + i, j * AROUND + next, (j + 1) * AROUND + next, (j + 1) * AROUND + i];
      triangles.push(a, b, c, a, c, d);
    }
  return { vertices_m: vertices, normals, triangles, pixels, weights };
}

export function scene(changes = {}) {
  return {
    type: "scene",
    version: "0.1.0",
    design: "cylinder30",
    frame_id: "cylinder30",
    touch: "conductance_rises",
    surface: { kind: "cylinder", radius_m: RADIUS_M, length_m: LENGTH_M },
    skin: mesh(),
    electrodes: electrodes().map(({ theta, z }) => ({ position_m: onCylinder(theta, z), normal: outward(theta), radius_m: 0.004 })),
    image: { pixel_count: ROWS * COLUMNS, rows: ROWS, columns: COLUMNS, position_in_grid: Array.from({ length: ROWS * COLUMNS }, (_, k) => k) },
    unrolled: {
      size_m: [WIDTH_M, LENGTH_M],
      wraps: true,
      labels: ["round (mm)", "along z (mm)"],
      electrodes_m: electrodes().map(({ theta, z }) => [RADIUS_M * theta, z]),
    },
    methods: ["best", "paper", "noser", "laplace"],
    emulated: true,
    quantity: "change",
    ...changes,
  };
}

/** A flat square of triangles without a grid: each triangle is a pixel, and the middle is the origin as on a disk. */
export function squareScene() {
  const [side, cells] = [0.2, 12];
  const [vertices, normals, triangles, pixels, weights] = [[], [], [], [], []];
  const middles = [];
  const at = (i, j) => [(i / cells - 0.5) * side, (j / cells - 0.5) * side, 0];
  for (let j = 0; j < cells; j += 1)
    for (let i = 0; i < cells; i += 1)
      for (const corners of [[[0, 0], [1, 0], [1, 1]], [[0, 0], [1, 1], [0, 1]]]) {
        const pixel = middles.length;
        const points = corners.map(([di, dj]) => at(i + di, j + dj));
        middles.push([0, 1].map((axis) => (points[0][axis] + points[1][axis] + points[2][axis]) / 3));
        for (const point of points) {
          triangles.push(vertices.length / 3);
          vertices.push(...point);
          normals.push(0, 0, 1);
          pixels.push(pixel, pixel, pixel, pixel);
          weights.push(1, 0, 0, 0);
        }
      }
  const ring = Array.from({ length: 16 }, (_, k) => [0.09 * Math.cos((k * Math.PI) / 8), 0.09 * Math.sin((k * Math.PI) / 8)]);
  return {
    middles,
    scene: scene({
      design: "square16",
      surface: { kind: "plane" },
      skin: { vertices_m: vertices, normals, triangles, pixels, weights },
      electrodes: ring.map(([x, y]) => ({ position_m: [x, y, 0], normal: [0, 0, 1], radius_m: 0.004 })),
      image: { pixel_count: middles.length, rows: null, columns: null, position_in_grid: null },
      unrolled: { size_m: [side, side], wraps: false, labels: ["x (mm)", "y (mm)"], electrodes_m: ring },
      quantity: "touch",
      emulated: true,
    }),
  };
}

/** The image of touches `{theta, z, force}`: some percent of the conductance for a newton, and a weak negative rim. */
export function image(touches, sequence) {
  const values = new Float32Array(ROWS * COLUMNS);
  for (let row = 0; row < ROWS; row += 1)
    for (let column = 0; column < COLUMNS; column += 1) {
      const [theta, z] = [((column + 0.5) / COLUMNS) * 2 * Math.PI, ((row + 0.5) / ROWS) * LENGTH_M];
      let value = 0.0006 * noise(900 * sequence + row * COLUMNS + column);
      for (const touch of touches) {
        const turn = Math.atan2(Math.sin(theta - touch.theta), Math.cos(theta - touch.theta));
        const distance = ((RADIUS_M * turn) ** 2 + (z - touch.z) ** 2) / SPREAD_M ** 2;
        value += 0.03 * touch.force * (Math.exp(-0.5 * distance) - 0.18 * Math.exp(-0.5 * (Math.sqrt(distance) - 3) ** 2));
      }
      values[row * COLUMNS + column] = value;
    }
  return values;
}

/** `form`: half length and half width, and the angle from the way round to the axis; m and radians. */
export function contact(id, { theta, z, force, form }, since) {
  const round = ((theta % (2 * Math.PI)) + 2 * Math.PI) % (2 * Math.PI);
  return {
    id,
    position_m: onCylinder(theta, z),
    normal: outward(theta),
    flat_m: [RADIUS_M * round, z],
    strength: 0.03 * force * 2 * Math.PI * SPREAD_M ** 2,
    area_m2: Math.PI * (1.18 * SPREAD_M) ** 2,
    direction: form ? [-Math.sin(theta) * Math.cos(form.angle), Math.cos(theta) * Math.cos(form.angle), Math.sin(form.angle)] : [null, null, null],
    half_length_m: form?.halfLengthM ?? null,
    half_width_m: form?.halfWidthM ?? null,
    force_n: force,
    force_sd_n: 0.3 * force,
    sd_m: 0.0012,
    confidence: 0.98,
    centroid_m: onCylinder(theta, z),
    centre_of_pressure_m: onCylinder(theta, z),
    velocity_m_s: [0, 0, 0],
    seen: true,
    since: Math.round(1e9 * since),
    age_s: 0,
    zone: null,
  };
}

/** A fixed scatter between -1 and 1. */
function noise(k) {
  const s = Math.sin(12.9898 * k + 78.233) * 43758.5453;
  return 2 * (s - Math.floor(s)) - 1;
}
