"""A cluster class that submits jobs with ``sbatch`` as dask-jobqueue does; its errors have the same text."""

from __future__ import annotations

import asyncio
import logging
import re
import sys
from pathlib import Path
from tempfile import NamedTemporaryFile

from distributed import Scheduler
from distributed.deploy.spec import ProcessInterface, SpecCluster


class Job(ProcessInterface):
    """One job, which is one worker."""

    submit_command = "sbatch"
    cancel_command = "scancel"

    def __init__(self, scheduler, name=None):
        self.scheduler_address, self.name, self.job_id = scheduler, name, None
        super().__init__()

    async def start(self):
        with NamedTemporaryFile("w", suffix=".sh", delete=False) as script:
            script.write(f"#!/bin/sh\nexec {sys.executable} -m distributed.cli.dask_worker {self.scheduler_address} ")
            script.write(f"--name {self.name} --nthreads 1 --no-nanny --no-dashboard --death-timeout 60\n")
        try:
            printed = await self.call(self.submit_command, script.name)
        finally:
            Path(script.name).unlink()
        self.job_id = re.search(r"\d+", printed).group()
        await super().start()

    async def close(self):
        if self.job_id is not None:
            await self.call(self.cancel_command, self.job_id)
        await super().close()

    @staticmethod
    async def call(*words):
        pipes = {"stdout": asyncio.subprocess.PIPE, "stderr": asyncio.subprocess.PIPE}
        process = await asyncio.create_subprocess_exec(*words, **pipes)
        out, err = await process.communicate()
        if process.returncode != 0:
            raise RuntimeError(
                f"Command exited with non-zero exit code.\nExit code: {process.returncode}\n"
                f"Command:\n{' '.join(words)}\n"
                f"stdout:\n{out.decode()}\nstderr:\n{err.decode()}\n"
            )
        return out.decode()


class Queue(SpecCluster):
    """A scheduler in this process, and jobs as its workers."""

    job_cls = Job

    def __init__(self):
        scheduler = {"cls": Scheduler, "options": {"dashboard": False, "host": "127.0.0.1"}}
        super().__init__(scheduler=scheduler, worker={"cls": Job}, silence_logs=logging.ERROR)
