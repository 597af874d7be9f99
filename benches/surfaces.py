"""Prints the rows of one or more `build.jsonl` as a Markdown table: errors, CPU seconds a stage, bytes by part."""

import json
import sys

STAGES = ["read", "downsample", "lobes", "choose", "group", "visibility", "fine", "interreflect", "smooth", "coarse", "fit", "encode", "measure"]
PARTS = ["heights", "lobes", "spatial", "angular", "base_color", "additive_angular"]


def percent(figure):
    return f"{100 * figure['value']:.2f} ± {100 * figure['standard_error']:.2f}"


rows = [json.loads(line) for path in sys.argv[1:] for line in open(path, encoding="utf-8") if line.strip()]
print("| surface | factor | lobes | ε < 75° % | ε > 75° % | on node % | bias % |", " | ".join(STAGES), end=" | ")
print("compile s | peak MiB | KB |", " | ".join(PARTS), "|")
print("|---" * (7 + len(STAGES) + 3 + len(PARTS)) + "|")
for row in rows:
    seconds = {stage["stage"]: stage["cpu_seconds"] for stage in row["stages"]}
    error = row["error"]
    cells = [row["name"], f"{row['factor'][0]:.3g}", str(row["lobes"]), percent(error["below_75"])]
    cells += [percent(error["above_75"]), f"{100 * row['on_node']:.2f}", percent(error["bias"])]
    cells += [f"{seconds.get(stage, 0):.2f}" for stage in STAGES]
    cells.append(f"{sum(s for stage, s in seconds.items() if stage != 'measure'):.2f}")
    cells.append(f"{row['peak_bytes'] / 2**20:.0f}")
    cells.append(f"{sum(row['bytes'].values()) / 1000:.0f}")
    cells += [f"{row['bytes'].get(part, 0) / 1000:.1f}" for part in PARTS]
    print("|", " | ".join(cells), "|")
