"""The records the fluid kernels work on. SI units, world axes; per metre of thickness in a plane.

Kernels run one thread a world and loop over its particles or cells: worlds take different numbers of sub-steps, and
sums are in a fixed order.
"""

import warp as wp

OPTIONS: dict[str, object] = {"enable_backward": False, "max_unroll": 1, "cpu_compiler_flags": "-march=native"}

PAD = 3  # cells outside the fluid's box, so that no stencil reaches beyond the arrays
PER_AXIS = 2  # particles along an edge of a cell at rest


@wp.struct
class Grid:
    """The cells, the same in all worlds. Cell (i, j, k) has number i stride[0] + j stride[1] + k stride[2]; a face has
    the number of the cell above it along its axis.

    origin: lower corner of cell (0, 0, 0). cell: its edge; volume, area: of a cell and of a face between cells, a
    metre thick in a plane. lower, upper: first cell of the box and the one after its last. thin: axis across the
    plane, -1 in space; it has one cell and stride 0. closed: whether the box has walls. wide: 1 along axes that flow.
    """

    origin: wp.vec3d
    box_lower: wp.vec3d
    box_upper: wp.vec3d
    cell: wp.float64
    volume: wp.float64
    area: wp.float64
    count: wp.vec3i
    stride: wp.vec3i
    lower: wp.vec3i
    upper: wp.vec3i
    wide: wp.vec3i
    thin: int
    closed: int
    cells: int


@wp.struct
class Particles:
    """(W, P): position, velocity, velocity gradient (APIC), fluid (-1 where absent). used (W,): rows ever filled.

    free (W,): all rows below it are filled.
    """

    x: wp.array2d[wp.vec3d]
    v: wp.array2d[wp.vec3d]
    gradient: wp.array2d[wp.mat33d]
    fluid: wp.array2d[wp.int32]
    used: wp.array[wp.int32]
    free: wp.array[wp.int32]
    volume: wp.float64


@wp.struct
class Fields:
    """On the grid, (W, C) or (W, 3, C) by axis of a face.

    velocity: at first momentum. push: impulse per volume that pressure gave [N s/m^3]. mass, bulk: mass and volume
    that the face's neighbourhood holds. open: fraction of a face that is not solid. room: fraction of a cell and its
    surroundings that is not solid. content: volume of liquid and soft bodies around a cell's centre, liquid: of
    liquid alone; filled: content over the room there. shift: move of the particles that evens out the content [m].
    level: signed distance to the free surface, negative in the liquid [m]. pressure [Pa]. unknown: row of the
    pressure system, -1 for none. known: whether a face's velocity is, counted in layers from the liquid.
    """

    velocity: wp.array3d[wp.float64]
    push: wp.array3d[wp.float64]
    mass: wp.array3d[wp.float64]
    bulk: wp.array3d[wp.float64]
    open: wp.array3d[wp.float64]
    known: wp.array3d[wp.int32]
    room: wp.array2d[wp.float64]
    content: wp.array2d[wp.float64]
    liquid: wp.array2d[wp.float64]
    level: wp.array2d[wp.float64]
    pressure: wp.array2d[wp.float64]
    shift: wp.array3d[wp.float64]
    filled: wp.array2d[wp.float64]
    unknown: wp.array2d[wp.int32]
    static_open: wp.array2d[wp.float64]  # (3, C)
    static_room: wp.array[wp.float64]  # (C,)
    static_distance: wp.array[wp.float64]  # (C,) from a cell's centre to the nearest static
    window: wp.array2d[wp.int32]  # (W, 6): first cell and the one after the last that matter now


@wp.struct
class System:
    """Symmetric equations of n[w] unknowns, row i: diagonal x_i + sum over neighbours coefficient x_neighbour.

    plus, minus (W, 3, N + 1): rows of the neighbours, N for none; coupling: coefficient of the one above.
    """

    n: wp.array[wp.int32]
    cell: wp.array2d[wp.int32]
    plus: wp.array3d[wp.int32]
    minus: wp.array3d[wp.int32]
    coupling: wp.array3d[wp.float64]
    diagonal: wp.array2d[wp.float64]
    precondition: wp.array2d[wp.float64]
    x: wp.array2d[wp.float64]
    residual: wp.array2d[wp.float64]
    z: wp.array2d[wp.float64]
    search: wp.array2d[wp.float64]
    product: wp.array2d[wp.float64]
    iterations: wp.array[wp.int32]  # in the last solve
    overflow: wp.array[wp.int32]
    rows: int


@wp.struct
class Solid:
    """A convex piece, a half space or a mesh, fixed in the axes of a body (or of the world, body -1).

    size: as in the rigid solver; across a plane it reaches beyond everything. half spaces: normal and `offset`.
    """

    kind: int
    body: int
    first_face: int
    faces: int
    offset: wp.float64
    bound: wp.float64
    size: wp.vec3d
    position: wp.vec3d
    rotation: wp.mat33d


@wp.struct
class Solids:
    """All solids (S,), those of bodies first, and the faces (unit normal, offset) of the convex ones; meshes by id.

    share (n,): metres of a body that one metre of the plane's slice stands for, 1 in space.
    """

    solids: wp.array[Solid]
    normals: wp.array[wp.vec3d]
    offsets: wp.array[wp.float64]
    meshes: wp.array[wp.uint64]
    share: wp.array[wp.float64]
    bodies: int  # number of rigid objects
    moving: int  # number of solids that belong to them


@wp.struct
class Wetted:
    """Faces that rigid bodies cover, found[w] of (W, E): what pressure pushes on.

    touching (W, E): count[w] of them that have an unknown on either side, or at both ends of a thin gap. lower, upper:
    rows of the cells on both sides. cover: covered fraction. beside, through: of a gap, in which pressure is linear,
    row of the far end and what pressure there pushes on, negative from above; else none and 0. arm: offset from the
    centre of mass crossed with the axis. force, torque (W, n): of the pressure, per metre in a plane; push, spin: what
    they do to the velocities. forecast, forecast_torque: mean force and torque over the last coupling step; before,
    torque_before: over the one before it; predicted_push, predicted_spin: changes predicted, and applied in advance.
    full (W,): 1 where there were more faces than `capacity`.
    """

    found: wp.array[wp.int32]
    count: wp.array[wp.int32]
    touching: wp.array2d[wp.int32]
    full: wp.array[wp.int32]
    body: wp.array2d[wp.int32]
    axis: wp.array2d[wp.int32]
    face: wp.array2d[wp.int32]
    lower: wp.array2d[wp.int32]
    upper: wp.array2d[wp.int32]
    cover: wp.array2d[wp.float64]
    beside: wp.array2d[wp.int32]
    through: wp.array2d[wp.float64]
    arm: wp.array2d[wp.vec3d]
    force: wp.array2d[wp.vec3d]  # (W, n)
    torque: wp.array2d[wp.vec3d]
    push: wp.array2d[wp.vec3d]
    spin: wp.array2d[wp.vec3d]
    forecast: wp.array2d[wp.vec3d]
    forecast_torque: wp.array2d[wp.vec3d]
    before: wp.array2d[wp.vec3d]
    torque_before: wp.array2d[wp.vec3d]
    predicted_push: wp.array2d[wp.vec3d]
    predicted_spin: wp.array2d[wp.vec3d]
    capacity: int


@wp.struct
class Pace:
    """Sub-steps: left (W,) of the coupling step, dt (W,) of this sub-step, 0 where a world is done; go (1,).

    present (W,): 1 where there are particles. lost (W,): first particle that is not a number or too fast now.
    whole (W,): mass of the particles; gained (W,): momentum that they have gained but for gravity's.
    given (W,): momentum that bodies and nodes have taken from the liquid in this sub-step. touching (W,): 1 where
    liquid is near a static or a side of the box, which then take momentum too. diverged (W,): first particle that is
    not a number or too fast, -1 for none. halted (1,): not 0 where the run was asked to end in the middle of a step.
    """

    halted: wp.array[wp.int32]
    left: wp.array[wp.float64]
    dt: wp.array[wp.float64]
    go: wp.array[wp.int32]
    steps: wp.array[wp.int32]
    fastest: wp.array[wp.float64]
    present: wp.array[wp.int32]
    lost: wp.array[wp.int32]
    given: wp.array[wp.vec3d]
    whole: wp.array[wp.float64]
    gained: wp.array[wp.vec3d]
    touching: wp.array[wp.int32]
    diverged: wp.array[wp.int32]


@wp.struct
class Resistance:
    """amount, sticky (W, C): viscosity times volume around a cell's centre, of all liquids and of those that stick.

    kind (W, 3, C): what a face is.
    """

    amount: wp.array2d[wp.float64]
    sticky: wp.array2d[wp.float64]
    kind: wp.array3d[wp.int32]


@wp.struct
class Viscous:
    """Equations of viscosity: row (W, 3, C) of each face, first the n[w] of liquid, then walls[w] in solids.

    mass (W, N): of a face with all its surroundings in the liquid. x: velocity, given in solids. active (W,); reach
    (W,): how well a boundary layer is resolved, 1 and more fully.
    """

    resistance: Resistance
    row: wp.array3d[wp.int32]
    n: wp.array[wp.int32]
    walls: wp.array[wp.int32]
    mass: wp.array2d[wp.float64]
    diagonal: wp.array2d[wp.float64]
    x: wp.array2d[wp.float64]
    residual: wp.array2d[wp.float64]
    z: wp.array2d[wp.float64]
    search: wp.array2d[wp.float64]
    product: wp.array2d[wp.float64]
    active: wp.array[wp.int32]
    reach: wp.array[wp.float64]
    iterations: wp.array[wp.int32]


@wp.struct
class Tension:
    """jump (W, C): pressure above the air's that the surface holds [Pa]; the others are room to work in."""

    jump: wp.array2d[wp.float64]
    smooth: wp.array2d[wp.float64]
    other: wp.array2d[wp.float64]
    strength: wp.array2d[wp.float64]
    normal: wp.array3d[wp.float64]


@wp.struct
class Liquids:
    """Parameters by fluid, (R, F), R is 1 or W; slip (F,). gravity (R,)."""

    density: wp.array2d[wp.float64]
    viscosity: wp.array2d[wp.float64]
    surface_tension: wp.array2d[wp.float64]
    slip: wp.array[wp.int32]
    gravity: wp.array[wp.vec3d]
