"""The search for fast gaits within a robot's torque, without a fall or a self-collision."""
