"""A fuzzer of the readers of other formats: `make fuzz-readers`."""
