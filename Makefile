.PHONY: engines sync format lint type contracts schema figures campaign variants screenshots browser-pictures docs gallery reader reference notebooks llms validate test test-fast build release-notes check all

sync:        ## install everything a developer needs
	uv sync --group dev
format:
	uv run --group dev ruff format .
	uv run --group dev ruff check --fix .
lint:
	uv run --group dev ruff format --check .
	uv run --group dev ruff check .
type:
	uv run --group dev mypy
contracts:
	uv run --group dev lint-imports
schema:      ## regenerate the committed JSON Schema
	uv run ffsm schema > scenarios/ffsm.schema.json
	uv run ffsm schema --campaign > scenarios/ffsm-campaign.schema.json
figures:     ## the pictures of docs/: verified-result, persistent-contact, capture, capture-detumble, missions, force-readings, co-simulation, grippers, joints, friction, sensitivity, fit
	uv run ffsm run baseline --no-rerun --force --out logs/figures
	uv run ffsm analyze logs/figures --plots docs/figures/baseline
	uv run python docs/contact_force.py
	uv run python docs/capture_figures.py
	uv run python docs/sensitivity_figure.py
	uv run python docs/fit_figure.py
	uv run python docs/detumble_figure.py
	uv run ffsm run capture-orbit --no-rerun --force --out logs/capture-orbit
	uv run ffsm analyze logs/capture-orbit --plots logs/capture-orbit-figures
	cp logs/capture-orbit-figures/orbit.svg logs/capture-orbit-figures/lvlh.svg docs/figures/capture-orbit
	uv run python docs/probe_and_cone.py
	uv run python docs/force_readings.py
	MUJOCO_GL=egl uv run python docs/nozzle_capture.py
	MUJOCO_GL=egl uv run python docs/handrail.py
	uv run python docs/berth.py
	uv run python docs/co_simulation.py
	uv run python docs/linkage_gripper.py
	uv run python docs/servo_arm.py
	uv run python docs/flexible_figure.py
	uv run python docs/friction_energy.py
	uv run python docs/grip_figure.py
	uv run python benchmarks/grip.py
validate:    ## regenerate the pages of validation, the seed paper's included: some minutes
	uv run ffsm validate --page docs
engines:     ## docs/engines.md from runs of other engines, in an environment of their own (1.5 GB); half an hour
	UV_PROJECT_ENVIRONMENT=build/engines uv run --group engines python benchmarks/engines.py
campaign:    ## docs/campaign-example.md and its first rows: 1024 runs, some ten minutes on two processors
	uv run ffsm campaign run baseline-dispersed --out logs/campaign-baseline-dispersed
	uv run ffsm campaign report logs/campaign-baseline-dispersed --page docs/campaign-example.md
	head -9 logs/campaign-baseline-dispersed/results.csv > docs/campaign-rows.csv
variants:    ## the figure of docs/variants.md: 64 runs, a minute on two processors
	uv run ffsm campaign run laws-after-impact --out logs/campaign-laws-after-impact
	uv run ffsm campaign report logs/campaign-laws-after-impact
	mkdir -p docs/figures/variants
	cp logs/campaign-laws-after-impact/figures/report/pareto.png docs/figures/variants
screenshots: ## the pictures of the Rerun viewer (a Vulkan driver is enough, e.g. mesa-vulkan-drivers)
	uv run --group dev python docs/screenshots.py
browser-pictures: reader ## the pictures of pages in a browser (Chromium and ChromeDriver)
	PYTHONPATH=. uv run --group dev python docs/browser_pictures.py
gallery:     ## docs/gallery.md and its pictures: some minutes
	MUJOCO_GL=egl uv run --group dev python -W ignore docs/gallery.py
docs:        ## the site, from docs/ and docstrings, with pages of all shipped scenarios, into build/site: some minutes; to look at without pages: uv run --group docs mkdocs serve
	uv run --extra html python -W ignore docs/gallery.py --pages
	uv run --group docs mkdocs build --strict --quiet
reader:      ## an independent reader of the viewer topics, for tests/browser (needs npm)
	cd tests/browser/reader && npm install --no-audit --no-fund --no-package-lock && npm run --silent build
notebooks:   ## execute the notebooks of docs/notebooks and store what they print and show
	uv run --group dev python docs/run_notebooks.py
llms:        ## llms.txt, the index of the user guide for language models
	python3 docs/site_hooks.py > llms.txt
reference:   ## regenerate the committed log reference
	uv run python docs/log_reference.py > docs/log-reference.md
test:        ## a tenth of the slow tests and all others; test-slow: all
	uv run --group dev pytest
test-slow:
	uv run --group dev pytest --slow
build:       ## build the wheel and try it in an empty environment
	uv build --wheel --out-dir dist
	uv run --isolated --no-project --with dist/*.whl --directory / ffsm check baseline
release-notes: ## the section of CHANGELOG.md of the version in pyproject.toml
	@version="$$(sed -n 's/^version = "\(.*\)"/\1/p' pyproject.toml)"; \
	awk -v version="$$version" '/^## / { on = ($$2 == version); next } on { print; lines++ } END { exit !lines }' CHANGELOG.md \
	|| { echo "CHANGELOG.md has no section of $$version" >&2; exit 1; }
check: lint type contracts
all: check test build
