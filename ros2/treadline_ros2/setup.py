"""An ament_python package; treadline itself is installed with pip."""

from pathlib import Path

from setuptools import setup

PACKAGE = 'treadline_ros2'

setup(
    name=PACKAGE,
    version='0.4.0',
    packages=[PACKAGE],
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (f'share/{PACKAGE}', ['package.xml']),
        *(
            (f'share/{PACKAGE}/{folder}', [str(file) for file in Path(folder).iterdir()])
            for folder in ('launch', 'rviz')
        ),
    ],
    install_requires=['setuptools', 'treadline'],
    zip_safe=True,
    license='Apache-2.0',
    entry_points={
        'console_scripts': [f'node = {PACKAGE}.node:main', f'climb = {PACKAGE}.client:main']
    },
)
