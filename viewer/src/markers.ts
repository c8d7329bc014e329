// Markers of the 3D view: electrodes (a shape for each state), contacts (ring or oval, and pin) and presses (cross).

import {
  type BufferAttribute,
  type BufferGeometry,
  CircleGeometry,
  Color,
  CylinderGeometry,
  Group,
  InstancedMesh,
  Matrix4,
  Mesh,
  MeshBasicMaterial,
  Quaternion,
  RingGeometry,
  Shape,
  ShapeGeometry,
  SphereGeometry,
  Vector3,
} from "three";

import { contactColour, INK, SLOT_COUNT, type Theme } from "./colours";
import { contactForm, type Form, LEAST_RADIUS_M, pointOnSkin } from "./form";
import type { Contact, ElectrodePlace, ElectrodeState, Surface, Vec3 } from "./types";

export const STATES: readonly ElectrodeState[] = ["sound", "doubtful", "suspect", "on_trial", "loose", "open"];
/** Faults are drawn larger than the electrode, by this factor. */
const FAULT_SIZE = 1.7;
const OUT = new Vector3(0, 0, 1);

/** Length of the pin of a force: it grows with the square root of the force. */
export function pinLength(contact: Contact, bodySize: number): number {
  const force = contact.force_n ?? 2;
  return bodySize * 0.16 * Math.sqrt(Math.max(force, 0.1) / 2);
}

/** Radius of the disc that has the contact's area; 8 mm where it is unknown. */
export function contactRadius(contact: Contact): number {
  return contact.area_m2 !== null && contact.area_m2 > 0 ? Math.max(Math.sqrt(contact.area_m2 / Math.PI), LEAST_RADIUS_M) : 0.008;
}

/** The shapes of the states, of radius one: disc, diamond, triangle, cross. */
function outlines(): Record<ElectrodeState, BufferGeometry> {
  const bar = (a: number): [number, number][] => {
    const [long, thin] = [1, 0.32];
    const corners: [number, number][] = [[-long, -thin], [long, -thin], [long, thin], [-long, thin]];
    return corners.map(([x, y]) => [x * Math.cos(a) - y * Math.sin(a), x * Math.sin(a) + y * Math.cos(a)]);
  };
  const shape = (points: [number, number][]): Shape => {
    const made = new Shape();
    points.forEach(([x, y], k) => (k === 0 ? made.moveTo(x, y) : made.lineTo(x, y)));
    return made;
  };
  const diamond = (): BufferGeometry => new ShapeGeometry(shape([[0, -1.1], [1.1, 0], [0, 1.1], [-1.1, 0]]));
  return {
    sound: new CircleGeometry(1, 20),
    doubtful: diamond(),
    suspect: diamond(),
    on_trial: diamond(),
    loose: new ShapeGeometry(shape([[-1.05, -0.65], [1.05, -0.65], [0, 1.2]])),
    open: new ShapeGeometry([shape(bar(Math.PI / 4)), shape(bar(-Math.PI / 4))]),
  };
}

function facing(normal: Vec3): Quaternion {
  return new Quaternion().setFromUnitVectors(OUT, new Vector3(...normal).normalize());
}

export class ElectrodeMarks {
  readonly group = new Group();
  private readonly marks: Record<ElectrodeState, { ink: InstancedMesh; halo: InstancedMesh }>;
  private shown = "";

  constructor(private readonly places: ElectrodePlace[]) {
    const shapes = outlines();
    const made = STATES.map((state) => {
      const pile = (order: number): InstancedMesh => {
        const mesh = new InstancedMesh(shapes[state], new MeshBasicMaterial(), places.length);
        mesh.count = 0;
        mesh.renderOrder = order;
        mesh.frustumCulled = false;
        this.group.add(mesh);
        return mesh;
      };
      return [state, { halo: pile(1), ink: pile(2) }] as const;
    });
    this.marks = Object.fromEntries(made) as typeof this.marks;
    this.update(places.map(() => "sound"));
  }

  setTheme(theme: Theme): void {
    for (const state of STATES) {
      colour(this.marks[state].ink).set(INK[theme][state]);
      colour(this.marks[state].halo).set(INK[theme].halo);
    }
  }

  update(states: ElectrodeState[]): void {
    const key = states.join();
    if (key === this.shown) return;
    this.shown = key;
    for (const state of STATES) {
      const { ink, halo } = this.marks[state];
      let count = 0;
      this.places.forEach((place, electrode) => {
        if ((states[electrode] ?? "sound") !== state) return;
        const size = place.radius_m * (state === "sound" ? 1 : FAULT_SIZE);
        ink.setMatrixAt(count, this.matrix(place, size, 0.0006));
        halo.setMatrixAt(count, this.matrix(place, size * 1.35, 0.0003));
        count += 1;
      });
      ink.count = halo.count = count;
      ink.instanceMatrix.needsUpdate = halo.instanceMatrix.needsUpdate = true;
    }
  }

  private matrix(place: ElectrodePlace, size: number, lift: number): Matrix4 {
    const at = new Vector3(...place.position_m).addScaledVector(new Vector3(...place.normal), lift);
    return new Matrix4().compose(at, facing(place.normal), new Vector3(size, size, size));
  }
}

function lyingAlong(form: Form, normal: Vec3): Quaternion {
  const axes = [form.along, form.across, normal].map((axis) => new Vector3(...axis)) as [Vector3, Vector3, Vector3];
  return new Quaternion().setFromRotationMatrix(new Matrix4().makeBasis(...axes));
}

function colour(mesh: Mesh): Color {
  return (mesh.material as MeshBasicMaterial).color;
}

/** The outline of a contact on the skin. */
class Outline extends Mesh<RingGeometry, MeshBasicMaterial> {
  private readonly ring: BufferAttribute;

  /** `half`: half of its thickness over its radius. An oval is as thick as a ring of the same area. */
  constructor(half: number, private readonly liftM: number) {
    super(new RingGeometry(1 - half, 1 + half, 40), new MeshBasicMaterial());
    this.ring = this.places().clone();
    this.frustumCulled = false;
  }

  /** A ring flat on the skin, or a form that follows it. */
  show(form: Form | null, radiusM: number, surface: Surface): void {
    const [halfLength, halfWidth] = form ? [form.halfLengthM, form.halfWidthM] : [radiusM, radiusM];
    for (let k = 0; k < this.ring.count; k += 1) {
      const [x, y] = [this.ring.getX(k), this.ring.getY(k)];
      const radius = Math.hypot(x, y);
      const beyond = (radius - 1) * Math.sqrt(halfLength * halfWidth);
      const place: Vec3 = [(x / radius) * (halfLength + beyond), (y / radius) * (halfWidth + beyond), this.liftM];
      this.places().setXYZ(k, ...(form ? pointOnSkin(form, surface, place) : place));
    }
    this.places().needsUpdate = true;
  }

  private places(): BufferAttribute {
    return this.geometry.getAttribute("position") as BufferAttribute;
  }
}

/** A ring or an oval on the skin with a light edge, and a pin along the normal with a head. */
class ContactMark {
  readonly group = new Group();
  readonly tip = new Vector3();
  private readonly ring = new Outline(0.14, 0.0016);
  private readonly edge = new Outline(0.22, 0.0012);
  private readonly pin: Mesh;
  private readonly head: Mesh;

  constructor(bodySize: number) {
    this.pin = new Mesh(new CylinderGeometry(bodySize * 0.004, bodySize * 0.004, 1, 8).rotateX(Math.PI / 2).translate(0, 0, 0.5), this.ring.material);
    this.head = new Mesh(new SphereGeometry(bodySize * 0.013, 14, 10), this.ring.material);
    this.group.add(this.edge, this.ring, this.pin, this.head);
  }

  show(contact: Contact, surface: Surface, ink: string, halo: string, bodySize: number): void {
    const form = contactForm(contact);
    const length = pinLength(contact, bodySize);
    this.group.position.set(...contact.position_m);
    this.group.quaternion.copy(form ? lyingAlong(form, contact.normal) : facing(contact.normal));
    for (const outline of [this.ring, this.edge]) outline.show(form, contactRadius(contact), surface);
    this.pin.scale.z = length;
    this.head.position.z = length;
    this.tip.set(...contact.position_m).addScaledVector(new Vector3(...contact.normal), length + bodySize * 0.013);
    colour(this.ring).set(ink);
    colour(this.edge).set(halo);
    this.group.visible = true;
  }
}

export class ContactMarks {
  readonly group = new Group();
  private readonly pool: ContactMark[] = [];
  private theme: Theme = "light";

  constructor(private readonly bodySize: number, private readonly surface: Surface) {}

  setTheme(theme: Theme): void {
    this.theme = theme;
  }

  /** Shows the contacts; returns the tips of their pins, where the labels go. */
  update(contacts: readonly Contact[], slots: readonly number[]): Vector3[] {
    while (this.pool.length < contacts.length) {
      const mark = new ContactMark(this.bodySize);
      this.pool.push(mark);
      this.group.add(mark.group);
    }
    this.pool.forEach((mark, k) => (mark.group.visible = k < contacts.length));
    return contacts.map((contact, k) => {
      const mark = this.pool[k] as ContactMark;
      mark.show(contact, this.surface, contactColour(this.theme, slots[k] ?? SLOT_COUNT), INK[this.theme].halo, this.bodySize);
      return mark.tip;
    });
  }
}

/** Where to press in a guided session: a target, ring and dot. */
export class GuideMark {
  readonly group = new Group();
  private readonly ink = new MeshBasicMaterial();
  private readonly halo = new MeshBasicMaterial();

  constructor(size: number) {
    const add = (shape: BufferGeometry, material: MeshBasicMaterial, lift: number): void => {
      const mesh = new Mesh(shape, material);
      mesh.position.z = lift / size;
      mesh.renderOrder = 3;
      this.group.add(mesh);
    };
    add(new RingGeometry(0.64, 1.1, 48), this.halo, 0.0016);
    add(new CircleGeometry(0.36, 32), this.halo, 0.0016);
    add(new RingGeometry(0.74, 1, 48), this.ink, 0.0022);
    add(new CircleGeometry(0.26, 32), this.ink, 0.0022);
    this.group.scale.setScalar(size);
    this.group.visible = false;
  }

  setTheme(theme: Theme): void {
    this.ink.color.set(INK[theme].accent);
    this.halo.color.set(INK[theme].halo);
  }

  update(place: { position: Vec3; normal: Vec3 } | null): void {
    this.group.visible = place !== null;
    if (!place) return;
    this.group.position.set(...place.position);
    this.group.quaternion.copy(facing(place.normal));
  }
}

/** Where the pointer presses: a cross; a contact is a ring or an oval. */
export class PressMarks {
  readonly group = new Group();
  private readonly shape: BufferGeometry;
  private readonly material = new MeshBasicMaterial();

  constructor(private readonly size: number) {
    this.shape = outlines().open.clone().rotateZ(Math.PI / 4);
  }

  setTheme(theme: Theme): void {
    this.material.color.set(INK[theme].text);
  }

  update(places: readonly { position: Vec3; normal: Vec3 }[]): void {
    while (this.group.children.length < places.length) {
      const mesh = new Mesh(this.shape, this.material);
      mesh.renderOrder = 3;
      this.group.add(mesh);
    }
    this.group.children.forEach((mesh, k) => {
      const place = places[k];
      mesh.visible = place !== undefined;
      if (!place) return;
      mesh.position.set(...place.position).addScaledVector(new Vector3(...place.normal), 0.002);
      mesh.quaternion.copy(facing(place.normal));
      mesh.scale.set(this.size, this.size, 1);
    });
  }
}
