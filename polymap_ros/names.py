"""Names that nobody knows, and what may be meant by them."""

from collections.abc import Sequence

_OF_ROS = ('use_sim_time', 'qos_overrides.', 'start_type_description_service')


def for_node(key: str, full_name: str) -> bool:
    """Whether a key of a parameter file is for a node: ``*`` stands for one name, ``**`` for any number of them."""
    return _match(_tokens(key), _tokens(full_name))


def _tokens(name: str) -> list[str]:
    return [token for token in name.split('/') if token]


def _match(key: list[str], name: list[str]) -> bool:
    if not key or not name:
        return all(token == '**' for token in key) and not name
    if key[0] == '**' and _match(key, name[1:]):
        return True
    return _match(key[1:], name) if key[0] == '**' else key[0] in ('*', name[0]) and _match(key[1:], name[1:])


def for_many(key: str) -> bool:
    """Whether a key of a parameter file is for nodes of any name, so that what it holds may be another's."""
    return key.rpartition('/')[2] in ('*', '**')


def full_name_in(keys: Sequence[str], node_name: str) -> str:
    """Say the full name of the node that keys of a parameter file are for, as far as they tell its namespace."""
    of_name = [key for key in keys if _tokens(key)[-1:] == [node_name]]
    namespaces = {tuple(_tokens(key)[:-1]) for key in of_name or keys if for_many(key) or key in of_name}
    told = {each for each in namespaces if each and '*' not in ''.join(each)}
    return '/' + '/'.join((*(told.pop() if len(told) == 1 else ()), node_name))


def misplaced(group: str, value: object) -> str:
    """Say what is wrong where a value, or nothing, stands in the place of a group of parameters."""
    found = 'nothing stands below it' if value is None else f'{value!r} stands in the place of its parameters'
    return f'{group} is a group, and {found}; indent them, or write such as solver: {{method: paper}}'


def suggestion(name: str, known: Sequence[str]) -> str:
    """Say which of the known names may be meant, preferably one in the same group."""
    group = name.partition('.')[0]
    near = [other for other in known if other.startswith(f'{group}.')] or list(known)
    close = _closest(name, near)
    return f'did you mean {close}?' if close else f'known: {", ".join(near)}'


def misspelt(found: Sequence[str], name: str) -> str:
    """Say that one of the names found may be meant to be `name`; empty where none comes near."""
    close = _closest(name, found)
    return f'; did you mean {name} by {close}?' if close and close != name else ''


def stray(name: str, known: Sequence[str]) -> str:
    """Say why a parameter that is left alone may have been meant for us; empty where nothing speaks for that.

    An unknown name below one of our groups may, and so may one that is nearly ours, or ours without its group.
    """
    if name in known or name.startswith(_OF_ROS):
        return ''
    group, _, key = name.partition('.')
    keys = [other.partition('.')[2] for other in known if other.startswith(f'{group}.')]
    short = [other for other in known if other.partition('.')[2] == name]
    if keys:
        close = f'{group}.{found}' if (found := _closest(key, keys)) else None
    else:
        close = short[0] if len(short) == 1 else _closest(name, known, 0.8)
    if not close and not keys:
        return ''
    advice = f'did you mean {close}?' if close else f'its group, {group}, is one of ours'
    return f'{name} is no parameter of polymap_ros and is left alone; {advice}'


def _closest(name: str, known: Sequence[str], cutoff: float = 0.6) -> str | None:
    import difflib

    return next(iter(difflib.get_close_matches(name, known, n=1, cutoff=cutoff)), None)
