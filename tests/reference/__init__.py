"""Slow NumPy twins of the paper's equations, one concept a file.

They import nothing of the project, so that they can judge it.

Every function that takes a `dtype` (np.float32 or np.float64) rounds each single operation in it,
in the order its docstring gives, so that a kernel can be compared with it bit for bit.
"""
