"""The replaceable parts of ICP: correspondence, rejection, robust kernels, estimation."""
