// Arrows in space, all of one colour in two draw calls.
import {
  type Color,
  ConeGeometry,
  CylinderGeometry,
  Group,
  InstancedMesh,
  Matrix4,
  MeshLambertMaterial,
  Quaternion,
  Vector3,
} from "three";

const up = new Vector3(0, 0, 1);
const way = new Vector3();
const turn = new Quaternion();
const matrix = new Matrix4();
const place = new Vector3();
const scale = new Vector3();

/** Room for `capacity` arrows; thickness [m]: radius of a shaft. */
export class Arrows {
  readonly object = new Group();
  private readonly shafts: InstancedMesh;
  private readonly heads: InstancedMesh;
  private count = 0;

  constructor(
    capacity: number,
    color: Color,
    private readonly thickness: number,
    opacity = 1,
  ) {
    const glow = { emissive: color, emissiveIntensity: 0.45 };
    const material = new MeshLambertMaterial({ color, ...glow, transparent: opacity < 1, opacity });
    const shaft = new CylinderGeometry(1, 1, 1, 12).translate(0, 0.5, 0).rotateX(Math.PI / 2);
    const head = new ConeGeometry(1, 1, 20).translate(0, 0.5, 0).rotateX(Math.PI / 2);
    this.shafts = new InstancedMesh(shaft, material, capacity);
    this.heads = new InstancedMesh(head, material, capacity);
    for (const part of [this.shafts, this.heads]) {
      part.frustumCulled = false;
      part.raycast = () => {};
      this.object.add(part);
    }
    this.done();
  }

  clear(): void {
    this.count = 0;
  }

  /** An arrow of `length` [m] along (x, y, z), which need not be a unit vector. */
  add(from: Vector3, x: number, y: number, z: number, length: number): void {
    way.set(x, y, z);
    const size = way.length();
    if (!(size > 0) || !(length > 0) || this.count >= this.shafts.instanceMatrix.count) return;
    way.divideScalar(size);
    turn.setFromUnitVectors(up, way);
    const head = Math.min(5 * this.thickness, 0.6 * length);
    const radius = Math.min(this.thickness, 0.2 * head);
    matrix.compose(from, turn, scale.set(radius, radius, length - head));
    this.shafts.setMatrixAt(this.count, matrix);
    place.copy(from).addScaledVector(way, length - head);
    matrix.compose(place, turn, scale.set(0.42 * head, 0.42 * head, head));
    this.heads.setMatrixAt(this.count, matrix);
    this.count++;
  }

  done(): void {
    for (const part of [this.shafts, this.heads]) {
      part.count = this.count;
      part.instanceMatrix.needsUpdate = true;
      part.visible = this.count > 0;
    }
  }
}
