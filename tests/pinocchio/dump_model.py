"""Writes a robot as Pinocchio reads it from a URDF, free-flyer base, in the plain text that bench.cpp reads.

Usage: dump_model.py ROBOT.urdf OUT.txt
One line a joint after the base: parent, axis (3), rotation (9, row-major), translation (3), then mass, centre of mass
(3), rotational inertia about it (9). The first line is the base's mass properties alone.
"""
import sys

import pinocchio as pin


def numbers(*arrays):
    return " ".join(f"{x:.17g}" for a in arrays for x in a)


model = pin.buildModelFromUrdf(sys.argv[1], pin.JointModelFreeFlyer())
data = model.createData()
pin.computeJointJacobians(model, data, pin.neutral(model))
with open(sys.argv[2], "w") as out:
    for i in range(1, model.njoints):
        inertia = model.inertias[i]
        body = numbers([inertia.mass], inertia.lever, inertia.inertia.ravel())
        if i == 1:
            print(body, file=out)
            continue
        # At the neutral posture the joint's Jacobian column, in its own frame, is its axis.
        column = pin.getJointJacobian(model, data, i, pin.ReferenceFrame.LOCAL)[3:, model.joints[i].idx_v]
        placement = model.jointPlacements[i]
        print(model.parents[i], numbers(column, placement.rotation.ravel(), placement.translation), body, file=out)
