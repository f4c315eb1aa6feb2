"""The command line: each command is a thin run over a library function."""
