"""A model file as MLflow serves it: MLflow runs this file and takes the model that it sets.

It is read as code, so that a registered model holds no pickle.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from mlflow.models import set_model
from mlflow.pyfunc import PythonModel

if TYPE_CHECKING:
    from mlflow.pyfunc import PythonModelContext


class ServedModel(PythonModel):
    """Vessel masks of a stack of frames."""

    def load_context(self, context: PythonModelContext) -> None:
        """Load the model file that lies in the registered model.

        Parameters
        ----------
        context : PythonModelContext
            Paths of its artifacts.
        """
        from models.predictor import Predictor

        self.predictor = Predictor.load(context.artifacts["model"])

    def predict(self, context: PythonModelContext, model_input: Any, params: Any = None) -> np.ndarray:
        """Segment frames.

        Parameters
        ----------
        context : PythonModelContext
            Has no effect.
        model_input : mapping or ndarray of uint8, shape (n, h, w)
            Frames, or these as ``frames``.
        params : Any, optional
            Has no effect.

        Returns
        -------
        ndarray of bool, shape (n, h, w)
            Masks.
        """
        del context, params
        frames = model_input["frames"] if isinstance(model_input, dict) else model_input
        masks: np.ndarray = self.predictor(np.asarray(frames))
        return masks


set_model(ServedModel())
