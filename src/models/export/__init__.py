"""A model for others: ONNX for other programs, a model card for readers."""
