"""What a simulated chair carries: drives, sensors and their errors, whichever simulator moves the bodies.

``sim`` (MuJoCo) and ``gazebo`` hand over where the chair is; from here on the two are the same chair.
"""
