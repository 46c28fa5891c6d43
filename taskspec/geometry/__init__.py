"""Surfaces as signed distances, feet and normals, and rotations, all as CasADi expressions."""
