"""The records of a step in one: what every stage of it reads and writes."""

import warp as wp

from polyworld.solver.core.episodes import Log
from polyworld.solver.spatial.joint_layout import Joints
from polyworld.solver.spatial.layout import Geometry, Parameters, State


@wp.struct
class System:
    """Records by reference, each an array of one: shapes, parameters, joints, state and contact log of the worlds."""

    geometry: wp.array[Geometry]
    parameters: wp.array[Parameters]
    joints: wp.array[Joints]
    state: wp.array[State]
    log: wp.array[Log]
