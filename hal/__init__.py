"""The robot's own software: bus client, robot control, locomotion controller and walk.

It talks to its servos through the official dynamixel-sdk and cannot know what is behind the port.
From ``busemu`` it takes only the control tables and the robot files.
"""
