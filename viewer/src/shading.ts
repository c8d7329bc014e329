// How the skin is drawn: the colour of a value from a table, little shaded, so that the scale can be read on the body.

import { DataTexture, DoubleSide, LinearFilter, NoColorSpace, RGBAFormat, ShaderMaterial } from "three";

import { TABLE_SIZE } from "./colours";

const VERTEX = `
  attribute float value;
  varying float shown;
  varying vec3 towardsEye;
  varying vec3 outward;
  void main() {
    vec4 seen = modelViewMatrix * vec4(position, 1.0);
    shown = value;
    towardsEye = -seen.xyz;
    outward = normalMatrix * normal;
    gl_Position = projectionMatrix * seen;
  }`;

// The edge of the body darkens (in the dark: brightens) a little, and its inside more, which is enough to read the shape.
const FRAGMENT = `
  uniform sampler2D colours;
  uniform float scale;
  uniform float edge;
  uniform vec3 inside;
  varying float shown;
  varying vec3 towardsEye;
  varying vec3 outward;
  void main() {
    vec3 colour = texture2D(colours, vec2(0.5 + shown * scale, 0.5)).rgb;
    float facing = abs(dot(normalize(outward), normalize(towardsEye)));
    float rim = 1.0 - facing;
    colour *= 1.0 + edge * rim * rim;
    if (!gl_FrontFacing) colour = mix(inside, colour, 0.22);
    gl_FragColor = vec4(colour, 1.0);
  }`;

export function skinMaterial(): ShaderMaterial {
  return new ShaderMaterial({
    vertexShader: VERTEX,
    fragmentShader: FRAGMENT,
    side: DoubleSide,
    polygonOffset: true,
    polygonOffsetFactor: 1,
    polygonOffsetUnits: 1,
    uniforms: { colours: { value: null }, scale: { value: 1 }, edge: { value: 0 }, inside: { value: [0, 0, 0] } },
  });
}

/** The table of colours as a texture; its bytes go to the screen as they are. */
export function tableTexture(table: Uint8Array): DataTexture {
  const texture = new DataTexture(new Uint8Array(table), TABLE_SIZE, 1, RGBAFormat);
  texture.colorSpace = NoColorSpace;
  texture.minFilter = texture.magFilter = LinearFilter;
  texture.needsUpdate = true;
  return texture;
}
