"""Run files: schema, writer, reader, traces and studies in HDF5."""
