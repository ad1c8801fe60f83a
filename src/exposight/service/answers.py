"""Examples of answers, for the description of the interface."""

from typing import Any

_EXPOSURE = {
    "exposure_ms": 12.5,
    "set_value": 12500.0,
    "set_unit": "us",
    "order": 1,
    "covers": ["P1", "P2"],
}
_OUTLOOK = {
    "feature": "P1",
    "status": "planned",
    "chance": 0.97,
    "view": "",
    "exposure_ms": 12.5,
    "window_ms": [6.1, 31.0],
    "reason": "",
}
_MATRIX = [[1, 0, 0, 12.5], [0, 1, 0, -3], [0, 0, 1, 600], [0, 0, 0, 1]]
_OUTCOME = {
    "feature": "P1",
    "status": "open",
    "p_norm": None,
    "exposure_ms": None,
    "reason": "",
}

EXAMPLES: dict[str, Any] = {
    "health": {
        "status": "ok",
        "version": "0.1.0",
        "uptime_s": 3600.5,
        "warm": True,
        "serves": {"models": 1, "campaigns": 2, "exposure_plans": 1},
    },
    "models": {"models": [{"name": "models", "sensor": "comet-pro-ae", "models": []}]},
    "parts": {
        "parts": [
            {"name": "campaign", "kind": "campaign", "part": "door", "features": ["P1", "P2"]}
        ],
        "sensors": ["sensor.json"],
    },
    "plans": {"exposure_plans": ["plan.json"], "measuring_plans": ["plan.toml"]},
    "forecast": {
        "best_exposure_ms": 12.5,
        "verdict": "1 of 1 features reach 0.75 with a chance of 90 % or more",
        "at_least": 0.75,
        "confidence": 0.9,
        "exposures_ms": [5.0, 12.5],
        "set_values": [5000.0, 12500.0],
        "set_unit": "us",
        "n_features_with_confidence": [0, 1],
        "features": [
            {
                "feature": "P1",
                "known": True,
                "unknown": "",
                "source": "pose",
                "wanted_ms": [8.0, 12.1, 18.3],
                "p_norm": [0.71, 0.98],
                "p_norm_low": [0.4, 0.9],
                "p_norm_high": [0.9, 1.0],
                "chance": [0.4, 0.97],
                "brightness": [33.0, 82.5],
            }
        ],
        "hidden": {"P9": "out of frame"},
        "notes": [],
    },
    "recommend": {
        "verdict": "take 1 exposure, 12.5 ms: 1 of 1 feature will reach 0.75",
        "view": "",
        "exposures_ms": [12.5],
        "exposures": [_EXPOSURE],
        "features": [_OUTLOOK],
        "hidden": {"P9": "out of frame"},
        "expected": 0.97,
        "expected_misses": 0.03,
        "proven": True,
        "time_ms": 12.5,
        "target": "p_norm",
        "need": 0.75,
        "confidence": 0.9,
        "prefer": "margin",
        "limits": "comet-pro-ae",
        "notes": [],
    },
    "plan": {
        "verdict": "1 capture in 1 view",
        "n_captures": 1,
        "plan": {"format": "exposight plan", "version": 1},
        "saved_as": None,
        "notes": [],
    },
    "observe": {
        "view": "capture",
        "sensor": "comet-pro-ae",
        "part": "door",
        "observations": [
            {"feature": "P1", "view": "capture", "exposure_ms": 12.5, "p_norm": 0.97, "i_avg": 80.2}
        ],
        "contradictions": [],
    },
    "next": {
        "done": False,
        "request": {
            "view": "front",
            "camera_from_part": _MATRIX,
            "exposure_ms": 12.5,
            "set_value": 12500.0,
            "set_unit": "us",
            "features": ["P1"],
            "why": "view front at 12.5 ms as planned",
        },
        "n_captures": 0,
        "decisions": [],
        "outcomes": [_OUTCOME],
        "verdict": "",
        "known": [],
        "contradictions": [],
    },
}
