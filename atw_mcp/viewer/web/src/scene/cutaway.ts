// Fixed solids between the eye and what moves are drawn thin, so that a box can be looked into.
import { type Camera, Matrix4, Mesh, type MeshStandardMaterial, Ray, Vector3 } from "three";

/** How much a solid covers that is in the way. */
const THIN = 0.18;

export class Cutaway {
  private readonly back = new Matrix4();
  private readonly eye = new Vector3();
  private readonly goal = new Vector3();
  private readonly ray = new Ray();
  private readonly hit = new Vector3();

  constructor(private readonly solids: Mesh[]) {
    for (const solid of solids) {
      solid.geometry.computeBoundingBox();
      solid.updateMatrixWorld();
    }
  }

  /** targets: places that should be seen. */
  update(camera: Camera, targets: Vector3[]): void {
    for (const solid of this.solids) {
      const material = solid.material as MeshStandardMaterial;
      const thin = targets.some((target) => this.between(camera, target, solid));
      if (material.transparent === thin) continue;
      material.transparent = thin;
      material.opacity = thin ? THIN : 1;
      material.depthWrite = !thin;
      material.needsUpdate = true;
    }
  }

  private between(camera: Camera, target: Vector3, solid: Mesh): boolean {
    this.back.copy(solid.matrixWorld).invert();
    this.goal.copy(target).applyMatrix4(this.back);
    // parallel rays of an orthographic eye come from far behind it
    if ("isOrthographicCamera" in camera) {
      this.eye.set(0, 0, 1).transformDirection(camera.matrixWorld).multiplyScalar(1e3).add(target);
    } else this.eye.setFromMatrixPosition(camera.matrixWorld);
    this.eye.applyMatrix4(this.back);
    this.ray.origin.copy(this.eye);
    this.ray.direction.copy(this.goal).sub(this.eye).normalize();
    const box = solid.geometry.boundingBox!;
    if (box.containsPoint(this.goal)) return false;
    return this.ray.intersectBox(box, this.hit) !== null && this.hit.distanceTo(this.eye) < this.goal.distanceTo(this.eye);
  }
}
