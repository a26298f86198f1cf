"""The logged command recomputed with the deployed law."""
