"""Actors that move the object: a person's hand or a robot's gripper."""
