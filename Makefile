# Everything a newcomer types. `make` alone lists it.
.DEFAULT_GOAL := help
SHELL := /bin/bash
PYTHON ?= python3
STUDY ?= demo
DURATION ?=
HOURS ?=
INPUT ?=
PORT ?=
KIND ?=
FLAGS ?=
NAME ?=
TLS ?=
HOST ?=
RUN := .venv/bin/python
SOURCES := $(wildcard interfaces/*/src services/*/src)
# one word of the shell, whatever is in it
quoted = '$(subst ','\'',$(1))'
COMPOSE := compose/docker.sh compose -f $(call quoted,$(if $(filter %.yaml %.yml,$(STUDY)),$(STUDY),compose/studies/$(STUDY).yaml))
# HTTPS before the page: TLS=the name by which browsers reach this machine
HTTPS := $(if $(TLS),-f compose/tls.yaml)
TLS_NAME := $(patsubst [%],%,$(TLS))
IN_URL := $(if $(findstring :,$(TLS_NAME)),[$(TLS_NAME)],$(TLS_NAME))
PAGE := $(if $(TLS),https://$(IN_URL):$${TLS_PORT:-8443},http://127.0.0.1:$${GUI_PORT:-8080})
TLS_ADDRESS ?=
export TLS_NAME TLS_ADDRESS
# of a study on several machines, the part of HOST
OF_HOST := $(if $(HOST),-f "$$part")
PART := $(if $(HOST),part="$$(.venv/bin/python compose/host_override.py --study $(call quoted,$(STUDY)) --host $(call quoted,$(HOST)) $(if $(TLS),--tls))" &&)
TOKENS = $(PYTHON) compose/study_tokens.py $(call quoted,$(STUDY))

.PHONY: help env demo test lint generate pictures new-driver new-interpreter new-service bench soak images compose-v2 up down logs ps lock k8s check study licences sbom clean

help: ## this list
	@grep -hE '^[a-z0-9-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z0-9-]+):.*## /make \1\t/' | expand -t 22

env: ## .venv with every service and the test tools; quick when nothing changed
	@$(PYTHON) interfaces/environment.py

demo: env ## one session of a study, no Docker: STUDY=demo (virtual participants), polar or a file; DURATION=60 INPUT=file PORT=8090 HOST=lab-a
	@$(RUN) compose/demo.py --study $(call quoted,$(STUDY)) $(if $(DURATION),--duration $(DURATION)) $(if $(INPUT),--input $(call quoted,$(INPUT))) $(if $(PORT),--port $(PORT)) $(if $(HOST),--host $(call quoted,$(HOST)))

study: env ## a new study file: NAME=pilot, FLAGS="--participants 2 --sensors h10,verity"; asks where there are no FLAGS
	@$(RUN) compose/new_study.py $(call quoted,$(NAME)) $(FLAGS)

check: env ## what is wrong with a study, before anything starts: STUDY=demo or a file; HOURS=2 of recording; HOST=lab-a: its part
	@$(RUN) compose/check_study.py --study $(call quoted,$(STUDY)) $(if $(HOST),--host $(call quoted,$(HOST))) $(if $(HOURS),--hours $(HOURS))

test: env ## every test this machine can run; says what it leaves out; SLOW=1: also those that take minutes of a core each
	@$(RUN) tests/run.py $(if $(SLOW),--slow)

lint: env ## ruff and mypy
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .
	.venv/bin/mypy $(SOURCES)
	MYPYPATH="$$(echo $(SOURCES) | tr ' ' :)" .venv/bin/mypy --config-file tests/bench/mypy.ini tests/bench

generate: env ## what is written from something else: default.yaml and the README's table of every service, docs/devices.md, k8s/demo and k8s/polar
	@$(RUN) interfaces/template/generate.py
	@$(RUN) k8s/render_study.py

pictures: env ## the README's pictures of the page, taken anew
	@$(RUN) tests/browser/take_pictures.py

NEW := $(RUN) interfaces/template/new.py
TIDY := .venv/bin/ruff format -q services tests/unit && .venv/bin/ruff check -q --fix services tests/unit

new-driver: env ## a new driver: NAME=acme, KIND=serial (tty, Unix socket, TCP, Bluetooth Classic), ble, lsl or bare; docs/adding-a-sensor.md
	@$(NEW) driver $(call quoted,$(NAME)) $(call quoted,$(KIND)) && $(TIDY)

new-interpreter: env ## a new interpreter: NAME=the sensor type that it reads; docs/adding-an-interpreter.md
	@$(NEW) interpreter $(call quoted,$(NAME)) && $(TIDY)

new-service: env ## a new service of any other kind: NAME=...
	@$(NEW) service $(call quoted,$(NAME)) && $(TIDY)

bench: env ## the numbers of docs/benchmarks.md
	$(RUN) tests/bench/run.py

soak: env ## a long run of the demo graph
	$(RUN) tests/bench/soak.py $(if $(DURATION),--duration $(DURATION))

images: ## the base image and one image per service
	@compose/images.sh

compose-v2:
	@said="$$(compose/docker.sh compose version 2>&1)" || { echo "$$said" >&2; \
		echo "make up needs Docker Compose v2. Ubuntu: apt-get install docker-compose-v2; Debian 13: docker-compose; Debian 12 has none: Docker's own package docker-compose-plugin" >&2; exit 1; }

up: $(if $(HOST),env) compose-v2 images ## start a study in containers: STUDY=demo, polar or a file; TLS=name: over HTTPS; HOST=lab-a: its part; with .venv there (make env; HOST= makes it) it is checked first
	@if [ -x $(RUN) ]; then $(RUN) compose/check_study.py --as containers --study $(call quoted,$(STUDY)) --host $(call quoted,$(HOST)); else echo "not checked: make env"; fi
	@tokens="$$($(TOKENS) --compose --host $(call quoted,$(HOST)))" && $(PART) $(COMPOSE) $(HTTPS) -f "$$tokens" $(OF_HOST) up --detach
	@$(COMPOSE) $(HTTPS) ps
	@if $(COMPOSE) $(HTTPS) ps --services | grep -qx web-gui; then \
		echo "the page, for whoever may operate: $$($(TOKENS) --link "$(PAGE)")"; \
		echo "          for whoever may look on: $$($(TOKENS) view --link "$(PAGE)")"; \
	else echo "no page runs on this machine"; fi
	@if $(COMPOSE) $(HTTPS) ps --services | grep -qx prometheus; then \
		echo "metrics and alerts: http://127.0.0.1:$${PROMETHEUS_PORT:-9090}, user study; its password is printed by: $(TOKENS) view"; \
	fi
	@echo "to stop it: make down STUDY="$(call quoted,$(STUDY))

down: ## stop it
	$(COMPOSE) $(HTTPS) down --remove-orphans
	@left="$$(compose/docker.sh compose ls --quiet | grep '^sense4hri-' | paste -sd ' ')"; \
		[ -z "$$left" ] || echo "still running: $$left; make down STUDY=NAME stops a study"

logs: ## follow its logs
	$(COMPOSE) $(HTTPS) logs --follow

ps: ## its containers
	@$(COMPOSE) $(HTTPS) ps

lock: ## resolve every requirements*.in and interfaces/build-requirements.txt anew, shared packages alike
	@$(PYTHON) interfaces/environment.py lock

k8s: env ## writes k8s/STUDY for Kubernetes from the same study file: STUDY=demo, polar or a file
	@$(RUN) k8s/render_study.py $(call quoted,$(STUDY))

licences: env ## the licence of everything shipped, and what is in which image
	@$(RUN) interfaces/bill/bill.py licences

sbom: env ## a software bill of materials (CycloneDX) for each image, in build/sbom
	@$(RUN) interfaces/bill/bill.py sbom build/sbom

clean: ## remove what was built; recordings stay
	rm -rf .venv build
	find . -name __pycache__ -prune -exec rm -rf {} +
