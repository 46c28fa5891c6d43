# Everything a fresh machine needs is set up here: a virtual environment in .venv with taskspec and
# its development tools. Only Python 3.11 or newer and make are asked for.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready

.PHONY: demo test theory proof stability lint types schema validate fuzz corruptions faults kills long lowest bench
.PHONY: docs docs-shown docs-pages docs-site vscode scene docs-serve steps foreign native exported designs boundaries servo-designs equivalence truth tsid lerobot referee check identify-worlds robosuite cell-presses
.PHONY: clean layers sources hunting interface tune-worlds insertion peg-policy

demo: $(READY)  ## run the wiping task and say where its report is
	$(BIN)/taskspec run tasks/wipe-table.yaml

test: $(READY)  ## run all tests
	$(BIN)/pytest -n 2

theory: $(READY)  ## hold the laws against their theorems, 200 random files of each; docs/theory.md
	$(BIN)/pytest tests/theory --random-presses=200 --theory-table=docs/theory.md

layers: $(READY)  ## what a boundary layer costs: errors and torques over layers; docs/laws/sliding.md
	$(BIN)/python campaigns/layers.py --page docs/laws/sliding.md

sources: $(READY)  ## coarse-encoders by every source of velocities, sticking-joints with friction compensated or not
	$(BIN)/python campaigns/velocity_sources.py --page docs/laws/output-feedback.md

hunting: $(READY)  ## 120 random compensations of more friction than there is, which of them hunt, and what TS518 says
	$(BIN)/python campaigns/hunting.py --seed 7 --files 120 --page docs/laws/output-feedback.md

proof: $(READY)  ## 1000 random tasks with random limits, and how near to them each came
	$(BIN)/pytest tests/runner/test_runner_qp_random.py --random-tasks=1000

stability: $(READY)  ## hold predicted stability against runs, keep the table in docs/stability.md
	$(BIN)/pytest tests/stability --stability-table=docs/stability.md

steps: $(READY)  ## run all shipped tasks, keep how far their torque steps in docs/torque-steps.md
	$(BIN)/python tests/docs/torque_steps.py

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(READY)
	$(BIN)/mypy

schema: $(READY)  ## the JSON Schema on disk is the one that the models generate
	$(BIN)/taskspec schema --check schemas/taskspec-1.schema.json

validate: $(READY)
	$(BIN)/taskspec validate tasks/

fuzz: $(READY)  ## hold 100 000 spoiled files to what is promised of any text; failing ones in runs/fuzz
	$(BIN)/python tests/fuzz/campaign.py --files 100000

corruptions: $(READY)  ## kills, locks, full disks, 10 000 spoiled run folders; table in docs/faults.md
	$(BIN)/python campaigns/faults.py --corruptions 10000 --table docs/faults.md

kills: $(READY)  ## SIGKILL of a sweep and of its processes at 20 moments each; table in docs/faults.md
	$(BIN)/python campaigns/sweep_kills.py --moments 20 --table docs/faults.md

faults: $(READY)  ## 30 declared faults in every shipped task; table in docs/faults.md
	$(BIN)/python campaigns/declared_faults.py --rows runs/faults.jsonl --table docs/faults.md

long: $(READY)  ## memory of runs of 1, 10 and 60 simulated minutes; table in docs/faults.md
	$(BIN)/python campaigns/long_runs.py --minutes 1 10 60 --table docs/faults.md

FOREIGN := runs/foreign

foreign: $(READY)  ## 42 robots of other people: model terms, and a first task that wipes; 1.1 GB
	$(BIN)/python campaigns/foreign_robots.py --names | \
		xargs $(BIN)/pip install --quiet --no-deps --upgrade --target $(FOREIGN)
	$(BIN)/python campaigns/foreign_robots.py --packages $(FOREIGN)
	$(BIN)/python campaigns/first_tasks.py --packages $(FOREIGN) --page docs/robots.md

BASE ?= 19f4a73
equivalence: $(READY)  ## hold the tree against commit BASE: shipped and 200 random tasks, diagnostics
	$(BIN)/python campaigns/equivalence.py --base $(BASE)

native: $(READY)  ## hold both tiers of the native loop against Python's: shipped and 200 random tasks
	$(BIN)/python campaigns/native.py

exported: $(READY)  ## every shipped task as C: logs of 10 million ticks, other builds, worst ticks; docs/c.md
	$(BIN)/python campaigns/exported.py --ticks 10000000 --table docs/c.md

designs: $(READY)  ## sampled loops of 1440 tasks with mechanisms, whose designed gains are to be stable; docs/designed-gains.md
	$(BIN)/python campaigns/mechanism_tasks.py --tasks 1080 --page docs/designed-gains.md

boundaries: $(READY)  ## boundaries of force loops over servos: closed form, sampled loop, runs; docs/admittance-boundary.md
	$(BIN)/python campaigns/boundaries.py --page docs/admittance-boundary.md

servo-designs: $(READY)  ## designed gains of 500 random presses over servos, from their boundary; docs/admittance-boundary.md
	$(BIN)/python campaigns/servo_tasks.py --tasks 500 --page docs/admittance-boundary.md

tune-worlds: $(READY)  ## 14 random tasks tuned, and judged in 50 fresh worlds each; docs/how-to/tune.md
	$(BIN)/python campaigns/tuned_worlds.py --tasks 14 --fresh 50 --page docs/how-to/tune.md

identify-worlds: $(READY)  ## 500 hidden worlds identified from a run each: how often intervals hold; docs/identify.md
	$(BIN)/python campaigns/identified_worlds.py --seed 307 --worlds 500 --tasks judge --page docs/identify.md

SEED ?= 1
FILES ?= 2000
truth: $(READY)  ## hold what validate says of files of two generators against their runs; docs/truth.md
	$(BIN)/python campaigns/truth.py --seed $(SEED) --files $(FILES) --page docs/truth.md

LOWEST := $(VENV)-lowest

lowest: $(READY)  ## a fresh environment with the lowest versions that are allowed: demo, some tests
	rm -rf $(LOWEST)
	$(PYTHON) -m venv $(LOWEST)
	$(BIN)/python tests/packaging/lowest.py > $(LOWEST)/pins.txt
	$(LOWEST)/bin/pip install --quiet --editable '.[mcap,dask,dev]' --constraint $(LOWEST)/pins.txt
	$(LOWEST)/bin/taskspec validate tasks/
	$(LOWEST)/bin/taskspec run tasks/wipe-table.yaml --out $(LOWEST)/run
	$(LOWEST)/bin/taskspec export $(LOWEST)/run --csv --parquet --mcap
	$(LOWEST)/bin/pytest -n 2 tests/spec tests/text tests/control tests/laws tests/native tests/plant tests/runner/test_cli.py \
		tests/sweep/test_sweep.py tests/robot/test_robot_xacro.py tests/robot/test_robot_urdf.py tests/robot/test_robot_collada.py \
		tests/runner/test_mcap_readers.py tests/runner/test_recorded_messages.py tests/runner/test_export.py

LEROBOT := $(VENV)-lerobot

lerobot:  ## datasets read by LeRobot itself, in an environment of its own: 6 to 11 GB
	$(PYTHON) -m venv $(LEROBOT)
	$(LEROBOT)/bin/pip install --quiet --editable '.[lerobot,video]' pytest==9.1.1 pytest-xdist==3.8.0
	$(LEROBOT)/bin/pytest tests/runner/test_lerobot.py

tsid:  ## an environment with TSID, for the referee
	$(PYTHON) -m venv .tsid
	.tsid/bin/pip install -q --only-binary :all: tsid==1.7.1 pin==3.4.0 eiquadprog==1.2.9
	.tsid/bin/pip install -q "cmeel-urdfdom<5" "cmeel-tinyxml2<11"

robosuite:  ## an environment with robosuite, for benchmarks beside it
	$(PYTHON) -m venv .robosuite
	.robosuite/bin/pip install -q robosuite==1.5.2 mujoco==3.3.0 numpy==1.26.4 numba==0.68.1 mink==0.0.5

cell-presses:  ## presses on a cell that others have recorded, from a package; writes docs/how-to/cell
	$(PYTHON) -m venv .afmformats
	.afmformats/bin/pip install -q afmformats==0.18.7
	rm -rf .afmformats/source && mkdir .afmformats/source
	.afmformats/bin/pip download -q --no-deps --no-binary :all: --dest .afmformats/source afmformats==0.18.7
	tar -xzf .afmformats/source/*.tar.gz -C .afmformats/source
	.afmformats/bin/python campaigns/cell_presses.py .afmformats/source/afmformats-0.18.7

insertion: $(READY)  ## contacts in cuts against closed form, a tight peg in 1100 worlds; writes docs/insertion.md
	$(BIN)/python campaigns/insertion.py

peg-policy: $(READY)  ## a policy on a task file, the file alone, the learner without it; writes docs/how-to/learning.md
	$(BIN)/python campaigns/peg_policy.py --page docs/how-to/learning.md

interface: $(READY)  ## the same tasks by torques, velocities and positions; writes docs/interface.md
	$(BIN)/python benchmarks/bench_interface.py

referee: $(READY)  ## other people's laws in tasks of this project; writes docs/referee.md
	$(BIN)/python benchmarks/bench_referee.py

bench: $(READY)  ## what control costs, as multiples of bare mj_step, and a change of stage of a tick
	$(BIN)/python benchmarks/bench_loop.py
	$(BIN)/python benchmarks/bench_tiers.py
	$(BIN)/python benchmarks/bench_stages.py
	$(BIN)/python benchmarks/bench_validate.py
	$(BIN)/python benchmarks/bench_exact.py
	$(BIN)/python benchmarks/bench_exported.py

scene:  ## the script of the scene in pages, from runner/taskspec_runner/scene/js; needs npm
	cd runner/taskspec_runner/scene/js && npm ci --no-audit --no-fund && npm run build

vscode:  ## the extension for VS Code, as editors/vscode/taskspec-VERSION.vsix; needs npm
	cd editors/vscode && npm install --no-audit --no-fund && npx vsce package

docs: docs-shown docs-site  ## the site in build/site, its pictures and what its pages show made anew

docs-shown: $(READY)  ## draw the pictures again, write again what files and commands of the pages say
	$(BIN)/python docs/images/make.py
	$(BIN)/python docs/images/admittance.py
	$(BIN)/python docs/images/screens.py
	$(BIN)/python tests/docs/diagnostic_pages.py
	$(BIN)/python tests/docs/shown_pages.py
	$(BIN)/python tests/docs/signal_tables.py

docs-pages: $(READY)  ## write the sources of the site into build/pages: pages as a site has them, and those that are made
	$(BIN)/python docs/building/pages.py build

docs-site: docs-pages  ## build the site; a link that leads nowhere is an error
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet -f build/mkdocs.yml

docs-serve: docs-pages  ## show the site on http://127.0.0.1:8000 while one writes
	$(BIN)/python docs/building/pages.py build --watch & trap "kill $$!" EXIT; \
		NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs serve -f build/mkdocs.yml

check: lint types schema validate test

$(READY): pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --upgrade pip
	$(BIN)/pip install --quiet --no-compile --editable '.[dev,docs]'
	touch $(READY)

clean:
	rm -rf $(VENV) $(VENV)-lowest runs
