"""From the loop to a file and back: ring in shared memory -> recorder process -> HDF5 -> import and export."""
