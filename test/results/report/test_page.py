"""The page says what polygon.json says, escapes what a recording says, and is the same each time."""

import dataclasses
import html
import math
import re
import sys
import xml.etree.ElementTree as ElementTree

import pytest

from polymap_ros.errors import UsageError
from polymap_ros.results.report.index import Row, index_html
from polymap_ros.results.report.page import report_html
from polymap_ros.results.report.templating import require_jinja

HOSTILE = ('<script>alert(1)</script>', '"><img src=x onerror=alert(1)>', "' onload='x", ']]><!--', '{{ 7 * 7 }}',
           '\N{RIGHT-TO-LEFT OVERRIDE}gnp.exe', 'a\x00b\x1bc', '\udcff', '&lt;b&gt;', 'א ב')


def page(answer, cautions=()):
    return report_html(*answer[:1], cautions, answer[1]).decode()


def parsed(text):
    """The page as XML, which it is but for the tags that HTML leaves open."""
    return ElementTree.fromstring(re.sub(r'<(meta|link)\b([^>]*)>', r'<\1\2/>', text.removeprefix('<!DOCTYPE html>')))


def words(text):
    return ' '.join(' '.join(parsed(text).find('body').itertext()).split())


@pytest.mark.parametrize('name', ['square', 'ten', 'utm', 'pierced', 'ambiguous', 'open', 'silent'])
def test_every_answer_has_a_page_of_balanced_tags_and_unique_names(pages, made, name):
    text = page(pages[name], [made.caution])
    root = parsed(text)
    names = [node.get('id') for node in root.iter() if node.get('id')]
    assert len(names) == len(set(names))
    for node in root.iter():
        for target in (node.get('aria-labelledby', '') + ' ' + node.get('aria-describedby', '')).split():
            assert target in names
        if (node.get('href') or '').startswith('#'):
            assert node.get('href')[1:] in names
    assert text == page(pages[name], [made.caution])


def test_the_numbers_are_those_of_the_document(pages, made):
    document, heard = pages['utm']
    found = words(report_html(document, [made.caution], heard).decode())
    for (x, y), edge in zip(document['vertices'], document['edges'], strict=True):
        for number in (f'{x:.5f} m', f'{y:.5f} m', f'{edge["length"]:.5f} m', f'{edge["r"]:.5f} m',
                       f'± {1e3 * edge["length_std"]:.2f} mm'):
            assert number in found
    assert '0.80000 m² ± 3.6 cm²' in found
    assert made.caution.finding in found
    assert made.caution.remedy in found
    assert 'dropped: no_pose Number 5 The last of them no odometry after 12.3 s' in found
    assert 'medium.model Value constant Default lamb_a0' in found
    assert 'grid.range_step_m' not in found


def test_holes_and_inner_walls_are_counted_drawn_and_measured(pages):
    document, _ = pages['pierced']
    text = page(pages['pierced'])
    found = words(text)
    assert 'Edges 4 Holes 2 Inner walls 1 Area without the holes' in found
    assert f'{document["area"]:.5f} m²' in found
    assert 'Least likelihood 0.960' in found
    for k, hole in enumerate(document['holes']):
        assert f'Hole H{k}: {len(hole["edges"])} edges, {hole["area"]:.5f} m²' in found
        for i, ((x, y), edge) in enumerate(zip(hole['vertices'], hole['edges'], strict=True)):
            assert f'Edge H{k}.{i} Length {edge["length"]:.5f} m' in found
            assert (f'Corner H{k}.{i} x {x:.5f} m y {y:.5f} m Inner angle {math.degrees(edge["angle"]):.3f}°') in found
    assert ('Wall W0 From x 0.750 m From y 0.020 m To x 0.720 m To y 0.780 m Reflects -0.250 Lets through 0.930'
            ) in found
    assert 'Wall W0 r -0.74900 m' in found
    assert 'outline and holes inner wall path and pings' in found
    assert 'W0 at ' in found
    assert not {'Holes', 'Inner walls'} & set(words(page(pages['square'])).split())


def test_an_ambiguous_answer_shows_every_candidate(pages):
    found = words(page(pages['ambiguous']))
    assert 'Candidate A: 4 edges, 0.80000 m² ± 3.6 cm²' in found
    assert 'Candidate B' in found
    assert 'Edge B3 Length 0.80000 m' in found


def test_an_open_answer_shows_walls_and_mirror_images(pages):
    found = words(page(pages['open']))
    assert 'Wall 1 r 1.00000 m' in found
    assert 'r 0.10000 m, θ 148.969°, likelihood 0.500' in found
    assert 'Corner' not in found


def test_without_pings_there_is_nothing_to_draw(pages):
    text = page(pages['silent'])
    assert 'There is nothing to draw: no ping was used.' in text
    assert '<figure' not in text


@pytest.mark.parametrize('hostile', HOSTILE)
def test_what_a_recording_says_is_escaped(pages, made, hostile):
    document, heard = pages['square']
    document = {**document, 'recording': hostile, 'frame_id': hostile,
                'parameters': {**document['parameters'], 'topics.echo': hostile}}
    caution = dataclasses.replace(made.caution, finding=hostile, remedy=hostile)
    texts = [report_html(document, [caution], dataclasses.replace(heard, drop_texts={'no_pose': hostile})).decode(),
             index_html([Row(hostile, 'closed', document), Row(hostile, 'failed', None, hostile)]).decode()]
    for text in texts:
        root = parsed(text)
        assert {node.tag for node in root.iter()} & {'script', 'img', 'b', 'iframe', 'object'} == set()
        assert not any(key.startswith('on') for node in root.iter() for key in node.attrib)
        assert all(re.fullmatch(r'(\./[\w%.-]+/)?[\w.]+|#[\w-]+|data:.*', node.get('href'), re.DOTALL)
                   for node in root.iter() if node.get('href') is not None)
        assert '49' not in html.unescape(text).split('<h1>')[1].split('</h1>')[0]
        seen = ''.join(root.itertext())
        assert not re.search('[\u202a-\u202e\u2066-\u2069\x00\x1b\udcff]', seen)
        if hostile.isprintable():
            assert hostile in seen


def test_what_cannot_be_seen_is_spelled_out(pages):
    document, heard = pages['square']
    text = report_html({**document, 'recording': '\u202eevil\x07'}, [], heard).decode()
    assert '<h1><bdi>[RIGHT-TO-LEFT OVERRIDE]evil[U+0007]</bdi></h1>' in text


def test_nothing_is_fetched_and_no_script_would_run(pages, made):
    text = page(pages['square'], [made.caution])
    outside = re.sub(r'xmlns="http://www.w3.org/2000/svg"|"data:image/png;base64,[\w/+=]+"', '', text)
    assert re.findall(r'(?:https?:)?//[^\s"<]+', outside) == []
    assert "default-src 'none'" in text


def test_an_index_counts_and_links(pages):
    rows = [Row('a b#c', 'closed', pages['square'][0]), Row('two', 'closed', pages['ten'][0], has_page=False),
            Row('three', 'open', pages['open'][0], 'drive a turn'), Row('four', 'failed', None, 'four.mcap: is empty')]
    text = index_html(rows).decode()
    assert text == index_html(rows).decode()
    found = words(text)
    assert '4 recordings 2 done, 1 open, 1 failed.' in found
    assert '1 recording ' in words(index_html(rows[:1]).decode())
    assert 'Total Edges 14 Area 3.73893 m² Pings used 156 of 180 Warnings 2' in found
    assert 'four.mcap: is empty' in found
    links = [node.get('href') for node in parsed(text).iter('a') if node.get('href').endswith('.html')]
    assert links == ['./a%20b%23c/report.html', './three/report.html']
    assert text.count('class="outline') == 2


def test_jinja_missing_says_how_to_get_it(monkeypatch):
    monkeypatch.setitem(sys.modules, 'jinja2', None)
    with pytest.raises(UsageError, match=r"pip install 'polymap_ros\[report\]'"):
        require_jinja()


def test_jinja_that_cannot_be_imported_is_told_before_the_work(monkeypatch, tmp_path):
    (tmp_path / 'jinja2.py').write_text('from markupsafe import soft_unicode')  # which newer ones have not
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, 'jinja2', raising=False)
    with pytest.raises(UsageError, match=r'--report needs Jinja2, which cannot be started: .*soft_unicode'):
        require_jinja()
    monkeypatch.delitem(sys.modules, 'jinja2', raising=False)
