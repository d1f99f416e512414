"""The few elements of SVG that the drawings are made of; every text and attribute is escaped."""

import unicodedata
import xml.etree.ElementTree as ElementTree
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

Node: TypeAlias = ElementTree.Element
Attribute: TypeAlias = str | float


def visible(text: str) -> str:
    """Return a text in which characters that cannot be seen, such as those that turn the direction, are spelled out."""
    return ''.join(each if each.isprintable() else ' ' if each.isspace() else _spelled(each) for each in text)


def drawing(width: float, height: float, name: str, title: str, description: str) -> Node:
    """Start a picture.

    Parameters
    ----------
    width, height : float
        Size in units of the drawing; on a page it takes the width that there is.
    name : str
        Identifies it within its page.
    title, description : str
        What a screen reader says in place of the picture.
    """
    root = ElementTree.Element('svg', {
        'viewBox': f'0 0 {number(width)} {number(height)}', 'role': 'img',
        'aria-labelledby': f'{name}-title', 'aria-describedby': f'{name}-desc'})
    add(root, 'title', visible(title), id=f'{name}-title')
    add(root, 'desc', visible(description), id=f'{name}-desc')
    return root


def add(parent: Node, tag: str, text: str = '', **attributes: Attribute) -> Node:
    """Add an element; underscores in the names of attributes stand for hyphens, a last one for nothing."""
    names = {key.rstrip('_').replace('_', '-'): value for key, value in attributes.items()}
    node = ElementTree.SubElement(parent, tag, {
        key: value if isinstance(value, str) else number(value) for key, value in names.items()})
    node.text = text
    return node


def path_data(points: ArrayLike, closed: bool = False) -> str:
    """Return the attribute ``d`` of a way through points (n, 2)."""
    steps = [f'{number(x)} {number(y)}' for x, y in np.asarray(points, dtype=float).reshape(-1, 2)]
    return f'M{"L".join(steps)}{"Z" if closed else ""}' if steps else ''


def markup(root: Node) -> str:
    """Return the text that goes into a page."""
    return ElementTree.tostring(root, encoding='unicode')


def number(value: float) -> str:
    """Return a number with two digits after the point at most."""
    return f'{round(float(value), 2) + 0.0:.2f}'.rstrip('0').rstrip('.')


def _spelled(character: str) -> str:
    return f'[{unicodedata.name(character, f"U+{ord(character):04X}")}]'
