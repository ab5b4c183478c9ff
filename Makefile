# Each target does its own set-up, so that it works in a fresh clone.
.PHONY: demo test test-slow check bench clean

demo: ## install percept and run the main job on the built-in drive
	scripts/setup
	.venv/bin/percept demo --out demo --force

test: ## install everything and pass all checks and tests
	scripts/setup dev
	scripts/oracles
	scripts/check
	.venv/bin/python -m pytest -n auto -m "not slow"

test-slow: ## the checks that take minutes
	scripts/setup dev
	scripts/oracles
	.venv/bin/python -m pytest -m slow

check: ## format, lint, types
	scripts/setup dev
	scripts/check

bench: ## ratios against other tools, on the real recordings beside the checkout
	scripts/setup dev
	scripts/bench

clean: ## remove what the targets above made
	rm -rf .venv .oracles build dist demo .hypothesis .mypy_cache .pytest_cache .ruff_cache
