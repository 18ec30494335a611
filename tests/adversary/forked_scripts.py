"""Work in forked processes, so that each starts with all modules already loaded."""

import faulthandler
import json
import os
import selectors
import signal
import traceback


def result_of(call, limit_s):
    """Return the result of a call in a forked process, transferred as JSON.

    Raises RuntimeError with a stack trace if the call exceeds its limit in real seconds, or ends its process.
    """
    read, write = os.pipe()
    child = os.fork()
    if not child:
        try:
            os.close(read)
            signal.signal(signal.SIGTERM, signal.SIG_DFL)
            faulthandler.dump_traceback_later(limit_s, exit=True, file=write)
            text = json.dumps(call())
            faulthandler.cancel_dump_traceback_later()
            with os.fdopen(write, "w") as result:
                result.write(text)
            os._exit(0)
        except BaseException:  # noqa: BLE001 - this process must not return to the parent's code
            traceback.print_exc()
        finally:
            os._exit(1)
    os.close(write)
    with os.fdopen(read) as result:
        text = result.read()
    _, status = os.waitpid(child, 0)
    if status:
        raise RuntimeError(f"it ended with {os.waitstatus_to_exitcode(status)} after at most {limit_s:g} s:\n{text}")
    return json.loads(text)


def workers(count, work):
    """Yield the lines that this many processes write. work: called with a number and a file."""
    begun = []
    for number in range(count):
        read, write = os.pipe()
        child = os.fork()
        if not child:
            try:
                os.close(read)
                signal.signal(signal.SIGTERM, signal.SIG_DFL)
                with os.fdopen(write, "w") as results:
                    work(number, results)
                os._exit(0)
            except BaseException:  # noqa: BLE001 - as above
                traceback.print_exc()
            finally:
                os._exit(1)
        os.close(write)
        begun.append((child, os.fdopen(read, "rb", buffering=0)))
    with selectors.DefaultSelector() as ready:
        for _, file in begun:
            ready.register(file, selectors.EVENT_READ)
        while ready.get_map():
            for key, _ in ready.select():
                if text := key.fileobj.readline():
                    yield text
                else:
                    ready.unregister(key.fileobj)
    for child, file in begun:
        os.waitpid(child, 0)
        file.close()
