"""Examples of answers in the OpenAPI document, by the name of their schema; a test checks each against its model."""

from __future__ import annotations

from typing import Any

_JOB = "5f2b8c0d9e1a4b37"
_CAMPAIGN = "1f0c9d2b7a6e5d43"
_SCHEDULE = "9a8b7c6d5e4f3a21"
_SHA256 = "786a663d40c9af756009c06f7974c605467e961660daeceb19dee28db2a444b7"
_METRICS = {
    "success": True,
    "steps_completed": 1222,
    "steps": 1222,
    "rmse_commanded_mm": 0.0028,
    "max_commanded_mm": 0.007,
}
_STEPS = "gives 244000 steps, at most 200000 are allowed here"
_SUITE = {"name": "lin100-v2-quick", "suite": "lin100-v2-quick", "suite_sha256": _SHA256}

JOB: dict[str, Any] = {
    "id": _JOB,
    "kind": "insertion",
    "name": "demo",
    "state": "running",
    "outcome": None,
    "attempt": 1,
    "priority": 0,
    "timeout_s": 3600.0,
    "pinned": False,
    "tags": ["liver", "paper-2"],
    "note": "",
    "progress": {
        "fraction": 0.5,
        "step": 611,
        "steps": 1222,
        "depth_mm": 59.2,
        "tip_error_mm": 0.1003,
        "cross_track_mm": 0.0019,
        "insertion_force_n": 1.71,
        "eta_s": 2.1,
    },
    "metrics": None,
    "error": None,
    "links": {
        "self": f"/api/v1/jobs/{_JOB}",
        "cancel": f"/api/v1/jobs/{_JOB}/cancel",
        "events": f"/api/v1/jobs/{_JOB}/events",
        "log": f"/api/v1/jobs/{_JOB}/log",
        "metrics": None,
        "series": None,
        "recording": f"/recordings/{_JOB}.rrd",
        "model": None,
        "artefacts": f"/api/v1/jobs/{_JOB}/artefacts",
    },
    "key": None,
    "created_at": "2026-11-29T02:00:00Z",
    "started_at": "2026-11-29T02:00:01Z",
    "finished_at": None,
}
_CAMPAIGN_LINKS = {
    "self": f"/api/v1/campaigns/{_CAMPAIGN}",
    **{name: f"/api/v1/campaigns/{_CAMPAIGN}/{name}" for name in ("cancel", "jobs", "results", "report")},
}

EXAMPLES: dict[str, dict[str, Any]] = {
    "JobSummary": JOB,
    "JobView": {
        **JOB,
        "scenario": {"schema": "needlebench/scenario/1", "name": "demo"},
        "training": None,
        "result": None,
    },
    "EventView": {
        "id": 36,
        "job": _JOB,
        "kind": "crashed",
        "attempt": 1,
        "at": "2026-11-29T02:00:05Z",
        "data": {"reason": "its worker process died (signal 9)"},
    },
    "MetricsView": {
        "job": _JOB,
        "status": "completed",
        "metrics": _METRICS,
        "timing": {"step_ms_median": 2.1},
        "digest": _SHA256,
    },
    "ArtefactView": {
        "kind": "recording",
        "name": "recording.rrd",
        "bytes": 4903997,
        "sha256": _SHA256,
        "url": f"/api/v1/jobs/{_JOB}/artefacts/recording.rrd",
    },
    "CampaignView": {
        "id": _CAMPAIGN,
        **_SUITE,
        "state": "running",
        "cancelling": False,
        "request": {"suite": "lin100-v2-quick"},
        "cases": 140,
        "jobs": {"finished": 70, "running": 2, "queued": 68},
        "fraction": 0.5,
        "eta_s": 180.0,
        "priority": -10,
        "timeout_s": 3600.0,
        "schedule": None,
        "created_at": "2026-11-29T02:00:00Z",
        "finished_at": None,
        "links": _CAMPAIGN_LINKS,
    },
    "JobDryRun": {
        "name": "demo",
        "steps": 1142,
        "nodes": 1617,
        "memory_mb": 480.0,
        "seconds": 7.0,
        "seconds_low": 5.5,
        "seconds_high": 9.0,
        "measured_on": 20,
    },
    "CampaignDryRun": {
        **_SUITE,
        "jobs": 140,
        "steps": 86592,
        "seconds": 360.0,
        "seconds_low": 240.0,
        "seconds_high": 540.0,
        "measured_on": 20,
        "first": ["lin-000-ifem", "lin-000-elm"],
    },
    "ScheduleView": {
        "id": _SCHEDULE,
        "name": "nightly",
        "cron": "0 2 * * *",
        "words": "At 02:00 every day",
        "timezone": "Europe/Paris",
        "catchup": "latest",
        "overlap": "forbid",
        "enabled": True,
        "campaign": {"suite": "lin100-v2-quick"},
        "next_run_at": "2026-11-30T01:00:00Z",
        "created_at": "2026-11-29T02:00:00Z",
        "version": 1,
    },
    "ScheduleRunView": {
        "scheduled_for": "2026-11-29T01:00:00Z",
        "fired_at": "2026-11-29T01:00:00.43Z",
        "outcome": "started",
        "campaign": _CAMPAIGN,
        "message": None,
    },
    "ComparisonView": {
        "campaigns": [_CAMPAIGN, "2e1d0c9b8a7f6e54"],
        "same_digests": 140,
        "shared_cases": 140,
        "arms": None,
        "comparisons": [],
    },
    "Readiness": {
        "status": "ready",
        "workers": 2,
        "workers_ready": 2,
        "problem": None,
        "warnings": [],
        "checks": [{"name": "disk", "level": "ok", "found": "77.7 GB free", "advice": ""}],
    },
    "ProblemDetails": {
        "type": "about:blank",
        "code": "scenario-invalid",
        "title": "Unprocessable Entity",
        "status": 422,
        "detail": "the scenario cannot be run: dt_s: " + _STEPS,
        "instance": "/api/v1/jobs",
        "errors": [{"field": "dt_s", "value": 0.0005, "message": _STEPS}],
    },
}
