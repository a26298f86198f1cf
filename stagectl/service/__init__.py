"""The service around the real-time process: orders, processes, recordings, installation."""
