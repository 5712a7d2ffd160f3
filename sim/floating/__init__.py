"""A robot on legs, compiled: rigid bodies on a free trunk, feet on level ground, drives at joints.

Whole recordings are rolled out in one call, several times as fast as step by step through a
physics engine. It is for replays: nothing of the robot touches anything of itself.
"""
