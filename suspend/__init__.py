"""suspend: dense suspensions of spheres under oscillatory shear.

`import suspend` is cheap: nothing is compiled or loaded until it is used.
"""

__version__ = "0.1.0"
