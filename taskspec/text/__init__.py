"""Reading text: strict YAML with positions, units, expressions, diagnostics."""
