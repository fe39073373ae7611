# boresight's tasks. `make` lists them.
.DEFAULT_GOAL := help
.PHONY: help setup demo test check schema deny doc bench fixtures fuzz

help: ## list the tasks
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## /  make \1 \t/' | expand -t 18

setup: ## install what is missing (system packages; asks for root only then)
	@scripts/setup

demo: setup ## build and run the built-in demo to the end
	cargo build --release --locked
	./target/release/boresight run pipelines/demo.toml

test: setup ## run all tests
	cargo test --locked --no-fail-fast

check: setup ## format, lints, tests: what a change must pass
	cargo fmt --check
	cargo clippy --locked --all-targets -- -D warnings
	cargo test --locked

schema: setup ## write the pipeline file's JSON Schema
	cargo run --release --locked -- schema > pipelines/boresight.schema.json

fixtures: setup ## make the demo's input again from its scenario
	cargo run --release --locked -- simulate fixtures/scenes/demo.toml --output fixtures/demo --force

fuzz: setup ## hostile files at every reader, a minute each (needs a nightly toolchain)
	scripts/fuzz 60

bench: setup ## compare with orthority in one run (needs python3 with venv)
	cargo build --release --locked
	benches/compare-orthority

deny: ## licences and sources of the dependencies (needs cargo-deny)
	cargo deny check licenses bans sources

doc: setup ## the library's documentation
	RUSTDOCFLAGS="-D warnings" cargo doc --locked --no-deps
