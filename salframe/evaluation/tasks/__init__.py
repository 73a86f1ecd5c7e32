"""Tasks by which methods are measured: one package per task, with its items, rows, columns and report."""
