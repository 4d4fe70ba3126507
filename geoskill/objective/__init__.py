"""The InMaxEnt objective as pure functions."""
