"""The stage as an actuator of Isaac Lab: friction as PhysX has it, armature, effort limit, delay."""
