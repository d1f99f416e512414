"""A headless Chromium, spoken to over its DevTools pipe: no driver, no port, no network."""

import fcntl
import json
import os
import select
import shutil
import subprocess
import time

NAMES = ('chromium', 'chromium-browser', 'google-chrome')
PATIENCE_S = 60.0


def find():
    """Path of a browser that can be had on this machine, or None."""
    return next((path for path in map(shutil.which, NAMES) if path), None)


class Browser:
    """One tab; `events` are what it reported since `open` was called."""

    def __init__(self, path, profile):
        # The ends of the pipe are descriptors 3 and 4 of the browser by definition; what they are made from is neither.
        ends = [*os.pipe(), *os.pipe()]
        to_read, self._write, self._read, to_write = (fcntl.fcntl(end, fcntl.F_DUPFD_CLOEXEC, 10) for end in ends)
        for end in ends:
            os.close(end)
        command = [path, '--headless', '--no-sandbox', '--disable-gpu', '--remote-debugging-pipe', '--no-first-run',
                   '--disable-background-networking', '--disable-extensions', f'--user-data-dir={profile}',
                   'about:blank']
        self._process = subprocess.Popen(
            command, pass_fds=(3, 4), preexec_fn=lambda: (os.dup2(to_read, 3), os.dup2(to_write, 4)),
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        os.close(to_read)
        os.close(to_write)
        self.events, self._count, self._buffer, self._session = [], 0, b'', None
        targets = self.call('Target.getTargets')['targetInfos']
        page = next(each['targetId'] for each in targets if each['type'] == 'page')
        self._session = self.call('Target.attachToTarget', targetId=page, flatten=True)['sessionId']
        for domain in ('Page', 'Network', 'Log', 'Runtime', 'Accessibility'):
            self.call(f'{domain}.enable')

    def call(self, method, **parameters):
        """Result of a command."""
        self._count += 1
        message = {'id': self._count, 'method': method, 'params': parameters}
        if self._session:
            message['sessionId'] = self._session
        os.write(self._write, json.dumps(message).encode() + b'\0')
        return self._wait(lambda answer: answer.get('id') == self._count)['result']

    def open(self, path, width=1200, height=900, scheme='light', medium='screen'):
        """Load a file as it is seen at some width, in a colour scheme, on a screen or on paper."""
        self.call('Emulation.setDeviceMetricsOverride', width=width, height=height, deviceScaleFactor=1, mobile=False)
        self.call('Emulation.setEmulatedMedia', media=medium,
                  features=[{'name': 'prefers-color-scheme', 'value': scheme}])
        self.events.clear()
        self.call('Page.navigate', url=path.as_uri())
        if not any(event['method'] == 'Page.loadEventFired' for event in self.events):
            self._wait(lambda answer: answer.get('method') == 'Page.loadEventFired')

    def value(self, expression):
        """What a JavaScript expression gives; the page's own content security policy does not hinder it."""
        answer = self.call('Runtime.evaluate', expression=expression, returnByValue=True)
        assert 'exceptionDetails' not in answer, answer
        return answer['result'].get('value')

    def close(self):
        """End the process."""
        os.close(self._write)
        self._process.terminate()
        self._process.wait(PATIENCE_S)
        os.close(self._read)

    def _wait(self, is_it):
        until_s = time.monotonic() + PATIENCE_S
        while True:
            while b'\0' not in self._buffer:
                ready, _, _ = select.select([self._read], [], [], max(until_s - time.monotonic(), 0.0))
                assert ready, 'the browser does not answer'
                data = os.read(self._read, 1 << 20)
                assert data, 'the browser is gone'
                self._buffer += data
            line, _, self._buffer = self._buffer.partition(b'\0')
            answer = json.loads(line)
            assert 'error' not in answer, answer
            if 'method' in answer:
                self.events.append(answer)
            if is_it(answer):
                return answer
