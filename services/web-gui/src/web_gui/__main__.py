"""Serve the page of a study: ROS graph in, browsers out."""

import asyncio
import sys

from sense4hri.access import Access
from sense4hri.http import broken_connections
from sense4hri.memory import give_large_blocks_back
from sense4hri.run import run
from sense4hri.service import Service
from sense4hri.version import software_version

from web_gui.config import Config
from web_gui.desk import Desk
from web_gui.graph import Graph
from web_gui.model import Study
from web_gui.server import Site, page_address, serve

TICK_S = 1.0


async def serve_page(service: Service[Config]) -> None:
    """Serve until the service is told to stop."""
    config = service.config
    study = Study(config.history_s, config.trend_s)
    access = Access.from_environment(config.host)
    site = Site(study, config, Desk(service, study), access=access, version=software_version("web_gui"))
    if notice := access.notice():
        service.log.warning(notice)
    runner, port = await serve(site, config, broken_connections(service.metrics).inc)
    Graph(service, study)
    service.metrics.gauge("browsers", "Browsers that are connected.").set_function(lambda: site.clients)
    service.metrics.counted("sent_frames", "Binary frames sent to browsers.", lambda: site.page.frames_total)

    async def look_for_reports() -> None:
        while not service.stopped.is_set():
            await site.look_for_report()
            await asyncio.sleep(TICK_S)

    service.every(TICK_S, site.page.tick)
    service.start(look_for_reports())
    service.log.info(f"the page is at {page_address(config.host, port)}")
    service.ready(True)
    try:
        await service.stopped.wait()
    finally:
        await runner.cleanup()


def main() -> int:
    """Run until stopped; return the exit status."""
    give_large_blocks_back()
    return run("web_gui", Config, serve_page)


if __name__ == "__main__":
    sys.exit(main())
