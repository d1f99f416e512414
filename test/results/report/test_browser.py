"""The pages in a real browser: on a phone, on paper, in the dark, by keyboard and to a screen reader."""

import os

import devtools
import pytest

from polymap_ros.results.report.index import Row, index_html
from polymap_ros.results.report.page import report_html

KINDS = ('square', 'ten', 'long', 'utm', 'pierced', 'ambiguous', 'open', 'silent', 'index')
LONG = 'warehouse_north_' * 12

CONTRAST = """(() => {
  const canvas = document.createElement('canvas').getContext('2d', {willReadFrequently: true});
  const rgb = colour => {
    canvas.clearRect(0, 0, 1, 1); canvas.fillStyle = colour; canvas.fillRect(0, 0, 1, 1);
    return [...canvas.getImageData(0, 0, 1, 1).data];
  };
  const luminance = c => c.slice(0, 3).map(v => v / 255)
    .map(v => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4)
    .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
  const behind = node => {
    for (let at = node; at; at = at.parentElement) {
      const colour = rgb(getComputedStyle(at).backgroundColor);
      if (colour[3] === 255) return colour;
    }
    return [255, 255, 255, 255];
  };
  let worst = [99, ''];
  for (const node of document.querySelectorAll('body, body *')) {
    const own = [...node.childNodes].some(child => child.nodeType === 3 && child.data.trim());
    const style = getComputedStyle(node);
    if (!own || style.display === 'none' || ['title', 'desc'].includes(node.tagName)) continue;
    const svg = node.closest('svg'), onMap = node.closest('.on-map');
    const front = luminance(rgb(svg ? style.fill : style.color));
    const back = luminance(onMap ? rgb(style.stroke) : behind(node));
    const ratio = (Math.max(front, back) + 0.05) / (Math.min(front, back) + 0.05);
    if (ratio < worst[0]) worst = [ratio, node.outerHTML.slice(0, 120)];
  }
  return worst;
})()"""


@pytest.fixture(scope='module')
def browser(tmp_path_factory):
    path = devtools.find()
    if path is None:
        assert os.environ.get('CI') != 'true', 'CI has to have a browser'
        pytest.skip('no Chromium on this machine, in which the pages of --report would be tried: apt install chromium')
    found = devtools.Browser(path, tmp_path_factory.mktemp('profile'))
    yield found
    found.close()


@pytest.fixture(scope='module')
def files(pages, tmp_path_factory):
    """Each kind of page as a file, with a name that is hard to break into lines."""
    folder = tmp_path_factory.mktemp('pages')
    contents = {kind: report_html({**document, 'recording': LONG}, [], heard)
                for kind, (document, heard) in pages.items()}
    rows = [Row(f'rosbag2_2026_11_29-16_21_0{kind[0]}', document['status'], document,
                'drive a turn' if kind == 'open' else '')
            for kind, (document, _) in pages.items()]
    contents['index'] = index_html([*rows, Row(LONG, 'failed', None, f'/data/{LONG}: is empty')])
    for kind, content in contents.items():
        (folder / f'{kind}.html').write_bytes(content)
    return {kind: folder / f'{kind}.html' for kind in contents}


@pytest.mark.parametrize('kind', KINDS)
def test_nothing_is_loaded_from_elsewhere_and_nothing_complains(browser, files, kind):
    browser.open(files[kind])
    requests = [event['params']['request']['url'] for event in browser.events
                if event['method'] == 'Network.requestWillBeSent']
    assert files[kind].as_uri() in requests
    assert [url[:60] for url in requests if url != files[kind].as_uri() and not url.startswith('data:')] == []
    assert [event for event in browser.events
            if event['method'] in ('Log.entryAdded', 'Runtime.consoleAPICalled', 'Runtime.exceptionThrown')] == []


@pytest.mark.parametrize('kind', KINDS)
@pytest.mark.parametrize('width', [320, 720, 1060])
def test_no_page_is_wider_than_the_screen(browser, files, kind, width):
    browser.open(files[kind], width=width)
    assert browser.value('document.documentElement.scrollWidth') <= width
    beyond = ("[...document.querySelectorAll('body *')].filter(node => node.getClientRects().length && "
              f"!node.closest('.skip, thead') && node.getBoundingClientRect().right > {width} + 1)"
              ".map(node => node.outerHTML.slice(0, 80))")
    assert browser.value(beyond) == []


@pytest.mark.parametrize('kind', ['square', 'pierced', 'ambiguous', 'open', 'index'])
@pytest.mark.parametrize(('scheme', 'medium'), [('light', 'screen'), ('dark', 'screen'), ('dark', 'print')])
def test_all_text_stands_out_from_its_ground(browser, files, kind, scheme, medium):
    browser.open(files[kind], scheme=scheme, medium=medium)
    ratio, what = browser.value(CONTRAST)
    assert ratio >= 4.5, what
    ground = browser.value("getComputedStyle(document.body).backgroundColor")
    assert (ground == 'rgb(255, 255, 255)') == (scheme == 'light' or medium == 'print')


@pytest.mark.parametrize('width', [360, 1200])
def test_a_screen_reader_meets_tables_pictures_and_landmarks(browser, files, width):
    browser.open(files['square'], width=width)
    nodes = browser.call('Accessibility.getFullAXTree')['nodes']
    roles = {}
    for node in nodes:
        if not node.get('ignored'):
            roles.setdefault(node['role']['value'], []).append(node.get('name', {}).get('value', ''))
    assert {'banner', 'main', 'contentinfo', 'navigation'} <= roles.keys()
    captions = roles['table']
    assert 'Edges, counter-clockwise; each lies on the line x cos θ + y sin θ = r' in captions
    assert all(captions)
    assert len(roles['rowheader']) >= 4 + 4 + 4
    assert {'Edge', 'Length', 'Likelihood', 'Inner angle'} <= set(roles['columnheader'])
    assert sum('± 0.011°' in name for name in roles['cell']) == 4
    pictures = roles.get('image', []) + roles.get('img', []) + roles.get('graphics-document', [])
    assert {'Outline', 'Beamforming map'} <= set(pictures)
    assert roles['heading'][0].startswith('warehouse_north')


@pytest.mark.parametrize('width', [1000, 1200, 1240, 1600])
def test_a_usual_name_is_not_broken_in_an_index(browser, files, width):
    browser.open(files['index'], width=width)
    heights, line = browser.value(
        "[[...document.querySelectorAll('tbody th bdi')].slice(0, -1).map(node => node.getBoundingClientRect().height),"
        " parseFloat(getComputedStyle(document.body).lineHeight)]")
    assert max(heights) < 1.5 * line
    assert browser.value('document.documentElement.scrollWidth') <= width


def test_by_keyboard_the_skip_link_comes_first_and_is_seen(browser, files):
    browser.open(files['square'], width=360)
    tab = {'key': 'Tab', 'code': 'Tab', 'windowsVirtualKeyCode': 9}
    seen = []
    for _ in range(9):
        for kind in ('keyDown', 'keyUp'):
            browser.call('Input.dispatchKeyEvent', type=kind, **tab)
        seen.append(browser.value(
            "(() => { const at = document.activeElement, box = at.getBoundingClientRect(); "
            "return [at.textContent, box.left >= 0, parseFloat(getComputedStyle(at).outlineWidth) >= 2]; })()"))
    assert seen[0][0] == 'Skip to the content'
    assert [text for text, _, _ in seen[1:7]] == ['Answer', 'Warnings', 'Edges and corners', 'Beamforming map', 'Pings',
                                                  'Parameters']
    assert all(inside and outlined for _, inside, outlined in seen[:8])


def test_paper_takes_a_few_pages(browser, files):
    browser.open(files['square'])
    printed = browser.call('Page.printToPDF', printBackground=False, paperWidth=8.27, paperHeight=11.69)
    assert len(printed['data']) > 20_000


def test_on_paper_no_short_table_is_torn_and_no_head_stands_alone(browser, files):
    browser.open(files['square'], medium='print')
    found = browser.value("[...document.querySelectorAll('table')].map(node => [getComputedStyle(node).breakInside, "
                          "getComputedStyle(node.querySelector('thead')).breakAfter])")
    assert found
    assert all(each == ['avoid', 'avoid'] for each in found)


def test_letters_of_a_drawing_are_large_enough_on_a_phone(browser, files):
    for kind in ('square', 'ten', 'long'):
        browser.open(files[kind], width=360)
        sizes = browser.value(
            "[...document.querySelectorAll('figure svg text')].map(node => parseFloat(getComputedStyle(node).fontSize)"
            " * node.closest('svg').getBoundingClientRect().width / node.closest('svg').viewBox.baseVal.width)")
        assert min(sizes) >= 9.0
