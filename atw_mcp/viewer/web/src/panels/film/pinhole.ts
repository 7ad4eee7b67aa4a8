// The video's own camera: pixel ~ K (R X + t), u to the right, v down, whole numbers at centres of pixels.
import { Camera, Matrix3, Matrix4, Plane, Ray, Vector3 } from "three";
import type { CameraView } from "../../document";

/** Rows of a map of pixels of the first frame to those of another: u' = m0 u + m1 v + m2, v' = m3 u + m4 v + m5. */
export type Motion = ArrayLike<number>;

const STILL: Motion = [1, 0, 0, 0, 1, 0];

/** World points to pixels. */
export class Pinhole {
  /** K moved with the camera, then K [R t]. */
  private readonly intrinsics: number[][];
  private readonly matrix: number[][];

  constructor(
    private readonly view: CameraView,
    motion: Motion = STILL,
  ) {
    const moved = [
      [motion[0]!, motion[1]!, motion[2]!],
      [motion[3]!, motion[4]!, motion[5]!],
      [0, 0, 1],
    ];
    this.intrinsics = product(moved, view.intrinsics);
    const pose = view.rotation.map((row, k) => [...row, view.translation[k]!]);
    this.matrix = product(this.intrinsics, pose);
  }

  /** Pixel of a point [m]; null where it is not in front of the camera. */
  project(x: number, y: number, z: number): [number, number] | null {
    const [u, v, w] = this.matrix.map((m) => m[0]! * x + m[1]! * y + m[2]! * z + m[3]!) as [number, number, number];
    return w > 1e-9 ? [u / w, v / w] : null;
  }

  /** Where the ray through a pixel meets a plane [m]; null where it does not, in front of the camera. */
  meets(u: number, v: number, plane: Plane): Vector3 | null {
    const rotation = new Matrix3().fromArray(this.view.rotation.flat()); // columns of three.js: transposed, its inverse
    const direction = new Vector3(u, v, 1).applyMatrix3(new Matrix3().fromArray(this.intrinsics.flat()).transpose().invert());
    const from = new Vector3().fromArray(this.view.translation).negate().applyMatrix3(rotation);
    return new Ray(from, direction.applyMatrix3(rotation).normalize()).intersectPlane(plane, new Vector3());
  }

  /** Distance of a point from the camera's plane [m]. */
  depth(x: number, y: number, z: number): number {
    const m = this.matrix[2]!;
    return m[0]! * x + m[1]! * y + m[2]! * z + m[3]!;
  }

  /** Set a camera of three.js so that it draws the whole frame; farthest: depth of what moves [m]. */
  aim(camera: Camera, farthest: number): void {
    const { width, height, rotation: r, translation: t } = this.view;
    const [[fx, skew, cx], [bx, fy, cy]] = this.intrinsics as [[number, number, number], [number, number, number]];
    const [near, far] = [farthest / 1000, farthest * 20];
    // camera axes of three.js: y up, z backwards; a pixel is 1 wide, its centre a whole number
    camera.projectionMatrix.set(
      (2 * fx) / width,
      (-2 * skew) / width,
      1 - (2 * cx + 1) / width,
      0,
      (-2 * bx) / height,
      (2 * fy) / height,
      (2 * cy + 1) / height - 1,
      0,
      0,
      0,
      -(far + near) / (far - near),
      (-2 * far * near) / (far - near),
      0,
      0,
      -1,
      0,
    );
    camera.projectionMatrixInverse.copy(camera.projectionMatrix).invert();
    const pose = new Matrix4().set(
      r[0]![0]!, r[0]![1]!, r[0]![2]!, t[0]!,
      -r[1]![0]!, -r[1]![1]!, -r[1]![2]!, -t[1]!,
      -r[2]![0]!, -r[2]![1]!, -r[2]![2]!, -t[2]!,
      0, 0, 0, 1,
    );
    camera.matrixAutoUpdate = false;
    camera.matrix.copy(pose).invert();
    camera.matrixWorld.copy(camera.matrix);
    camera.matrixWorldInverse.copy(pose);
  }
}

function product(a: number[][], b: number[][]): number[][] {
  return a.map((row) => b[0]!.map((_, j) => row.reduce((sum, value, k) => sum + value * b[k]![j]!, 0)));
}
