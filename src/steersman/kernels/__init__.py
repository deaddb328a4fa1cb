"""Compiled arithmetic: pure functions over arrays, each tested against its Python original."""
