"""Compiled primitives: capsules, the Viterbi pass, the triangles that a path crosses."""
