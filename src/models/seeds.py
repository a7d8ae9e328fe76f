"""Seeds: each purpose that random numbers are drawn for has a stream of its own."""

from __future__ import annotations

import numpy as np

from models.errors import InputError

# The purposes under one seed: the first weights (the same for all folds), and all that differs from fold to fold.
WEIGHTS, TRAINING = 0, 1
# The purposes within one epoch of a training.
SHUFFLING, AUGMENTATION, DROPOUT = 0, 1, 2


def seed_of(seed: int, *purpose: int) -> int:
    """Derive a seed for one purpose, unlike those of other purposes or of other seeds, 0 included.

    Parameters
    ----------
    seed : int
        Seed of the whole, at least 0.
    *purpose : int
        Numbers that name the purpose.

    Returns
    -------
    int
        Seed for torch.

    Raises
    ------
    InputError
        If the seed is negative.
    """
    if seed < 0:
        raise InputError(f"seed: expected a number from 0, received {seed}")
    return int(np.random.SeedSequence([seed, *purpose]).generate_state(1, np.uint32)[0])
