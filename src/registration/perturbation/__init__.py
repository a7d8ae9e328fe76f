"""Controlled perturbations of a registration problem."""

from registration.perturbation.perturbation import PLACES, Perturbation, Piece, Trial, draw

__all__ = ["PLACES", "Perturbation", "Piece", "Trial", "draw"]
