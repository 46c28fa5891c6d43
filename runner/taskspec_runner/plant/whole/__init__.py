"""Contacts of a tool's whole surface, one for each patch, in MuJoCo's own collision pass."""
