"""What methods are measured on: one package per task with its items, rows, columns and part of the report."""
