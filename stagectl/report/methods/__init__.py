"""The figures of each identification method, one module a method, by the name that a user types."""
