"""Results as text: columns, tables, their formats, and figures that papers report."""
