"""A result folder is complete, or untouched."""

import pytest

from polymap_ros.results.folder import result_folder


def test_files_appear_together_and_old_results_go(tmp_path):
    folder = tmp_path / 'a' / 'out'
    with result_folder(folder) as stage:
        (stage / 'polygon.json').write_text('1')
        (stage / 'map.pgm').write_text('1')
        assert not folder.exists()
    (folder / 'notes.txt').write_text('mine')
    with result_folder(folder) as stage:
        (stage / 'polygon.json').write_text('2')
        assert (folder / 'polygon.json').read_text() == '1'
    assert {path.name: path.read_text() for path in folder.iterdir()} == {'polygon.json': '2', 'notes.txt': 'mine'}
    assert [path.name for path in folder.parent.iterdir()] == ['out']


def test_a_failure_leaves_the_folder_as_it_was(tmp_path):
    def fail(folder):
        with result_folder(folder) as stage:
            (stage / 'polygon.json').write_text('new')
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fail(tmp_path / 'out')
    assert list(tmp_path.iterdir()) == []
    (tmp_path / 'out').mkdir()
    (tmp_path / 'out' / 'polygon.json').write_text('old')
    with pytest.raises(KeyboardInterrupt):
        fail(tmp_path / 'out')
    assert (tmp_path / 'out' / 'polygon.json').read_text() == 'old'
    assert [path.name for path in tmp_path.iterdir()] == ['out']


def test_a_file_in_the_way_is_an_error(tmp_path):
    (tmp_path / 'out').write_text('a file')
    with pytest.raises(FileExistsError), result_folder(tmp_path / 'out') as stage:
        (stage / 'polygon.json').write_text('new')
    assert [path.name for path in tmp_path.iterdir()] == ['out']
