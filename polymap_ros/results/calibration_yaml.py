"""calibration.yaml: what a calibration found, as a ROS parameter file for the next time."""

from collections.abc import Mapping

from polymap_ros.parameters import NODE_NAME


def calibration_yaml(values: Mapping[str, float], deviations: Mapping[str, float]) -> bytes:
    """The file's content; one standard deviation of each value is in a comment, and numbers keep their point."""
    lines = [f'{NODE_NAME}:', '  ros__parameters:']
    for group in dict.fromkeys(name.partition('.')[0] for name in values):
        lines.append(f'    {group}:')
        lines += [f'      {name.partition(".")[2]}: {value:#.8g}  # +- {deviations[name]:.2g}'
                  for name, value in values.items() if name.startswith(f'{group}.')]
    return '\n'.join([*lines, '']).encode()
