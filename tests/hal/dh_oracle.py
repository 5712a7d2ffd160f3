"""Forward kinematics by Denavit-Hartenberg matrices, from the robot file, without ``hal``."""

import numpy as np


def _link(theta, a, alpha):
    ct, st, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
    return np.array(
        [
            [ct, -st * ca, st * sa, a * ct],
            [st, ct * ca, -ct * sa, a * st],
            [0.0, sa, ca, 0.0],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def feet_by_matrices(robot, angles):
    links = robot.document["link"]
    feet = []
    for leg, joints in zip(robot.document["leg"], angles, strict=True):
        c, s = np.cos(leg["yaw_rad"]), np.sin(leg["yaw_rad"])
        pose = np.array(
            [[c, -s, 0, leg["x_m"]], [s, c, 0, leg["y_m"]], [0, 0, 1, 0], [0, 0, 0, 1.0]]
        )
        for part, angle in zip(("coxa", "femur", "tibia"), joints, strict=True):
            twist = links[part].get("twist_rad", {"value": 0.0})["value"]
            pose = pose @ _link(angle, links[part]["length_m"]["value"], twist)
        feet.append(pose[:3, 3])
    return np.array(feet)
