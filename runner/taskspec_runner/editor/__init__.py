"""A language server for task files: findings, completion, hover, definitions, renames, actions."""
