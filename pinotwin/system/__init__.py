"""What touches the operating system: files written whole or not at all, the threads of BLAS."""
