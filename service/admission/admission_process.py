"""The process in which a scenario or a campaign with an uploaded mesh is checked; JSON in, JSON out."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

from service.blas_threads import one_thread


def main() -> None:
    """Read the request from standard input; write {"answer": ...} or {"problems": [[field, value, message], ...]}."""
    one_thread()
    _limit_resources()
    asked = json.load(sys.stdin)
    json.dump(answer_to(asked), sys.stdout, default=str)


def answer_to(asked: dict[str, Any]) -> dict[str, Any]:
    """What `main` writes."""
    from service.admission.admission import admitted
    from service.admission.campaign_planner import CampaignRequest, planned
    from service.settings import Limits
    from simcore.errors import ScenarioError

    uploads, limits = Path(asked["uploads"]), Limits.model_validate(asked["limits"])
    try:
        if asked["kind"] == "campaign":
            answer = asdict(planned(CampaignRequest.model_validate(asked["value"]), uploads, limits))
        else:
            answer = asdict(admitted(asked["value"], uploads, limits))
    except ScenarioError as error:
        return {"problems": [[one.field, one.value, one.message] for one in error.problems]}
    return {"answer": answer}


def _limit_resources() -> None:
    """Limit memory and time of this process, for good."""
    if sys.platform != "win32":
        import resource

        from service.admission.admission import MEMORY_MB, TIME_S

        for kind, most in (
            (resource.RLIMIT_AS, MEMORY_MB * 10**6),
            (resource.RLIMIT_CPU, TIME_S),
            (resource.RLIMIT_CORE, 0),
        ):
            hard = resource.getrlimit(kind)[1]
            limit = most if hard == resource.RLIM_INFINITY else min(most, hard)
            resource.setrlimit(kind, (limit, limit))


if __name__ == "__main__":
    main()
