"""The real-time process: one cycle for every axis, its states, its stops, its safety."""
