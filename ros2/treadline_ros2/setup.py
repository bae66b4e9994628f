"""An ament_python package; treadline itself is installed with pip."""

from setuptools import setup

PACKAGE = "treadline_ros2"

setup(
    name=PACKAGE,
    version="0.3.0",
    packages=[PACKAGE],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        (f"share/{PACKAGE}/launch", ["launch/graph.launch.py"]),
        (f"share/{PACKAGE}/config", ["config/params.yaml"]),
    ],
    install_requires=["setuptools", "treadline"],
    zip_safe=True,
    license="Apache-2.0",
    entry_points={"console_scripts": [f"node = {PACKAGE}.node:main"]},
)
