# SPDX-License-Identifier: Apache-2.0
# The only build file.  `make help` lists the targets.

BUILD   ?= build
PREFIX  ?= /usr/local
DESTDIR ?=
CC      ?= cc
CXX     ?= c++
OPT     ?= -O2
ARM     ?= model/arms/pa10.toml
HDT_DATA ?= ../shared/data
export BUILD HDT_DATA

VERSION := $(shell awk '/define HDT_VERSION_(MAJOR|MINOR|PATCH)/{v=v s $$3; s="."} END{print v}' ctrl/hdt.h)
SOMAJOR := $(firstword $(subst ., ,$(VERSION)))

# build with every core unless told otherwise
ifeq ($(filter -j%,$(MAKEFLAGS)),)
MAKEFLAGS += -j$(shell nproc 2>/dev/null || echo 2)
endif

WARN  := -Wall -Wextra -Wpedantic -Wconversion -Wshadow -Werror
CWARN := $(WARN) -Wstrict-prototypes -Wmissing-prototypes
INC   := -I. -I$(BUILD)/gen
DEP    = -MMD -MP
LINK  := -lcrypto -llcm -lpthread -lm
CHECK := -lcheck_pic -lsubunit -lrt

obj = $(patsubst %,$(BUILD)/obj/%.o,$(1))
CTRL   := $(call obj,$(wildcard ctrl/*.c))
DRIVER := $(call obj,$(wildcard driver/*.c))
LCMGEN := $(BUILD)/obj/gen/hdt_cycle_t.o $(BUILD)/obj/gen/hdt_run_t.o
STATUS := $(BUILD)/obj/gen/hdt_status_t.o
SIM    := $(call obj,$(wildcard sim/*.c))
MODEL  := $(call obj,$(wildcard model/*.cpp))
TOOLS  := $(call obj,$(wildcard tools/hdt*.cpp))
BENCH  := $(patsubst tools/%.c,$(BUILD)/%,$(wildcard tools/bench_*.c))
TESTS  := $(patsubst tests/%.c,$(BUILD)/tests/%,$(wildcard tests/check_*.c)) \
          $(patsubst tests/%.cpp,$(BUILD)/tests/%,$(wildcard tests/check_*.cpp))
SLOW   := $(addprefix $(BUILD)/tests/check_,bench_diagnosis cli commands dataset diagnose diagnose_adopt evidence ident log_check measured paper rbd rt scan task telemetry)
LIBS   := $(BUILD)/librig.a $(BUILD)/libhdt.a
READY  := $(BUILD)/.ready
# what `make install` puts under include/hdt: the library exports these headers' functions
PUBLIC := ctrl/hdt.h ctrl/hdt_q.h ctrl/hdt_tables.h \
          $(addprefix driver/,hdt_bus.h drv_telegram.h drv_cycle.h drv_dump.h drv_log.h drv_host.h drv_rt.h hdt_plugin.h)

.PHONY: all demo paper measured check check-install check-posix linuxcnc check-linuxcnc check-asan run-asan check-mujoco fmu check-fmu bench bench-core bench-pinocchio bench-sim bench-diagnosis bench-ident install clean help guards
.PHONY: check-cross fuzz check-mutation check-coverage check-proof check-misra
.DELETE_ON_ERROR:
.SECONDARY:

## all: libraries and build/hdt
all: $(BUILD)/libhdt.a $(BUILD)/libhdt.so.$(VERSION) $(BUILD)/hdt

## demo: the whole loop in the rig; EFFECT=cable_spring=8@2 chooses what is hidden, DATA=DIR a measured arm
demo: $(BUILD)/hdt
	@if [ -n "$(DATA)" ]; then tools/demo --data "$(DATA)"; else tools/demo $(EFFECT); fi

## paper: the experiments of Kennedy and Desai 2005 in the rig, beside the paper's numbers
paper: $(BUILD)/hdt
	@$(BUILD)/hdt paper --arm model/arms/pa10.toml --out $(BUILD)/paper

## measured: real arms: import, fit, diagnose the logs in HDT_DATA, a page an arm in docs/measured
measured: $(BUILD)/hdt $(BUILD)/measured_page
	@tools/measured

## check: guards and all tests
check: guards check-install $(TESTS) $(BUILD)/hdt
	@tools/run-tests $(TESTS)

## check-install: what a user gets: exports, headers alone, pkg-config, and the README's host run against the servo
check-install: all
	@tools/check-exports $(BUILD)/libhdt.so.$(VERSION) $(BUILD)/libhdt.a $(PUBLIC)
	@CC="$(CC)" CXX="$(CXX)" tools/check-install $(BUILD)

## check-asan: the C rooms and everything that reads files, under address and undefined-behaviour sanitizers
check-asan:
	$(MAKE) BUILD=$(BUILD)/asan OPT="-O1 -g -fsanitize=address,undefined -fno-sanitize-recover=all" run-asan
run-asan: $(filter-out $(SLOW),$(TESTS))
	@tools/run-tests $^

## check-cross: the core on other processors (QEMU), both byte orders, bare Cortex-M: the same bytes
check-cross: $(BUILD)/hdt
	@CC="$(CC)" tools/check-cross $(BUILD)

## fuzz: RUNS=20000 mutated table images through loader and step, under sanitizers (libFuzzer)
fuzz: $(BUILD)/hdt
	@CC="$(CC)" tools/check-fuzz $(BUILD) $(or $(RUNS),20000)

## check-coverage: the core's tests run every line and branch of ctrl/
check-coverage:
	@tools/check-coverage $(BUILD)

## check-misra: cppcheck's MISRA C:2012 addon over ctrl/; what docs/misra.md does not list fails
check-misra:
	@tools/check-misra

## check-proof: no run-time error in loader and step, for any input, by Frama-C Eva; docs/proof.md
check-proof:
	@tools/check-proof $(BUILD)

## check-mutation: every change of one thing in gate and arithmetic fails a test; SAMPLE=N of them only
check-mutation:
	@tools/check-mutation $(BUILD) $(if $(SAMPLE),--sample $(SAMPLE) --seed $(or $(SEED),1))

# a Python with one package, in build/; without the package index the target is skipped, aloud
python = { test -x $(BUILD)/venv/bin/python || python3 -m venv $(BUILD)/venv; } && \
  { $(BUILD)/venv/bin/python -c 'import $(1)' 2>/dev/null || \
    $(BUILD)/venv/bin/pip install -q --disable-pip-version-check $(or $(2),$(1)); } || \
  { echo "SKIP: $@: pip cannot install $(or $(2),$(1)); is the package index reachable?"; exit 0; }

## check-mujoco: MuJoCo (by pip, in build/) finds the torques of exported arms that ours finds
check-mujoco: $(BUILD)/hdt $(BUILD)/tests/rbd_torques
	@$(call python,mujoco); $(BUILD)/venv/bin/python tests/mujoco_torques.py $(BUILD)

## fmu: ARM=model/arms/pa10.toml with its servo driver as an FMI 3.0 co-simulation unit, in build/
fmu: $(BUILD)/fmu_gen
	@CC="$(CC)" OPT="$(OPT)" tools/make-fmu $(BUILD) $(ARM)

## check-fmu: FMPy (by pip, in build/) validates the PA-10's unit and runs it beside the servo driver itself
check-fmu: $(BUILD)/fmu_gen $(BUILD)/tests/fmu_direct
	@CC="$(CC)" OPT="$(OPT)" tools/make-fmu $(BUILD) model/arms/pa10.toml
	@$(call python,fmpy); $(BUILD)/venv/bin/python tests/fmu_run.py $(BUILD)

.PHONY: check-vm check-dbc fuzz-telegram bench-bus
## check-vm: sockets, tests, and host and servo in real time on a PREEMPT_RT kernel with CAN, in QEMU; build/vm/out.all
check-vm: $(BUILD)/hdt $(addprefix $(BUILD)/tests/check_,bus net telegram)
	@tools/check-vm all

## check-dbc: cantools (by pip, in build/) decodes our CAN traffic by docs/hdt-servo.dbc to our numbers; check-vm's too
check-dbc: $(BUILD)/tests/can_traffic
	@$(call python,cantools); $(BUILD)/venv/bin/python tests/dbc_decode.py $(BUILD)

## fuzz-telegram: RUNS=300000 of libFuzzer over codec, CAN padding and ARCNET packets, under sanitizers (clang-19)
fuzz-telegram:
	@tools/fuzz-telegram $(BUILD) $(or $(RUNS),300000)

guards: $(CTRL)
	@tools/check-layers
	@tools/check-lines
	@tools/check-core-symbols $(CTRL)

## check-posix: ctrl/ and driver/ with another C library (musl) that shows POSIX and nothing else, and run
check-posix:
	@CC="$(CC)" tools/check-posix $(BUILD)

## linuxcnc: the HAL component, build/linuxcnc/hdt.so (needs linuxcnc-uspace-dev: tools/deps --linuxcnc)
linuxcnc: $(BUILD)/linuxcnc/hdt.so
$(BUILD)/linuxcnc/hdt.so: driver/linuxcnc/hdt.c $(PUBLIC) $(BUILD)/libhdt.a
	@[ -f /usr/include/linuxcnc/hal.h ] || { echo "no /usr/include/linuxcnc/hal.h: run tools/deps --linuxcnc" >&2; exit 2; }
	@mkdir -p $(@D) && echo "  CC  $<" && $(CC) $(OPT) -std=gnu99 -Wall -Wextra -Werror -fPIC -shared -DRTAPI -DUSPACE -D__MODULE__ \
	  -isystem /usr/include/linuxcnc -I. -Wl,-Bsymbolic -Wl,--exclude-libs,ALL -o $@ $< $(BUILD)/libhdt.a

## check-linuxcnc: the HAL component in LinuxCNC against the emulated servo (skipped, aloud, where it cannot be installed)
check-linuxcnc: $(BUILD)/hdt
	@tools/deps --linuxcnc || { echo "SKIP: $@: linuxcnc-uspace cannot be installed: see the line above"; exit 0; }; \
	MAKEFLAGS= $(MAKE) -s BUILD=$(BUILD) linuxcnc && tools/check-linuxcnc $(BUILD)

## bench: bench-core and bench-sim
bench: bench-core bench-sim

## bench-core: what a period of the core costs: time, instructions (STATES=10000), stack, code; on a Cortex-M4
bench-core: $(BUILD)/bench_core $(BUILD)/hdt
	@CC="$(CC)" OPT="$(OPT)" tools/bench-core

## bench-pinocchio: a whole period of the core beside the torques of Pinocchio (by pip, in build/) for the same arm
bench-pinocchio: $(BUILD)/bench_core
	@$(call python,pinocchio,pin); CXX="$(CXX)" OPT="$(OPT)" tools/bench-pinocchio

## bench-sim: the plant alone: time of chain and steps, error of Runge-Kutta; and the same arm in MuJoCo
bench-sim: $(BUILD)/bench_sim
	@$(BUILD)/bench_sim
	@$(call python,mujoco); $(BUILD)/venv/bin/python tools/bench_mujoco.py $(BUILD)

## bench-bus: round trips over our buses beside a bare ping-pong of the same bytes; CAN in check-vm's machine
bench-bus: $(BUILD)/bench_bus $(BUILD)/hdt
	@$(BUILD)/bench_bus
	@tools/check-vm bench

## bench-diagnosis: hidden effects in many arms, named or not; N=3 of each, JOBS= at a time; build/bench-diagnosis/page.md
bench-diagnosis: $(BUILD)/hdt $(BUILD)/bench_diagnosis
	@nice -n 10 $(BUILD)/bench_diagnosis --hdt $(BUILD)/hdt --out $(BUILD)/bench-diagnosis -n $(or $(N),3) \
	  $(if $(JOBS),-j $(JOBS))

## bench-ident: what ident and diagnose take on ten minutes of seven joints; a sparse regression; a Stribeck fit
bench-ident: $(BUILD)/hdt $(BUILD)/bench_ident
	@$(BUILD)/bench_ident --hdt $(BUILD)/hdt --out $(BUILD)/bench-ident

## install: library, headers, pkg-config file and hdt under DESTDIR/PREFIX
install: all
	install -d $(DESTDIR)$(PREFIX)/bin $(DESTDIR)$(PREFIX)/lib/pkgconfig \
	  $(DESTDIR)$(PREFIX)/include/hdt/ctrl $(DESTDIR)$(PREFIX)/include/hdt/driver \
	  $(DESTDIR)$(PREFIX)/share/hdt/arms
	install -m 755 $(BUILD)/hdt $(DESTDIR)$(PREFIX)/bin/
	install -m 644 $(BUILD)/libhdt.a $(DESTDIR)$(PREFIX)/lib/
	install -m 755 $(BUILD)/libhdt.so.$(VERSION) $(DESTDIR)$(PREFIX)/lib/
	ln -sf libhdt.so.$(VERSION) $(DESTDIR)$(PREFIX)/lib/libhdt.so.$(SOMAJOR)
	ln -sf libhdt.so.$(SOMAJOR) $(DESTDIR)$(PREFIX)/lib/libhdt.so
	install -m 644 $(filter ctrl/%,$(PUBLIC)) $(DESTDIR)$(PREFIX)/include/hdt/ctrl/
	install -m 644 $(filter driver/%,$(PUBLIC)) $(DESTDIR)$(PREFIX)/include/hdt/driver/
	install -m 644 model/arms/*.toml $(DESTDIR)$(PREFIX)/share/hdt/arms/
	printf '%s\n' 'prefix=$(PREFIX)' 'Name: hdt' 'Description: control core and driver for harmonic-drive arms' \
	  'Version: $(VERSION)' 'Cflags: -I$${prefix}/include/hdt' 'Libs: -L$${prefix}/lib -lhdt' >$(DESTDIR)$(PREFIX)/lib/pkgconfig/hdt.pc

## clean: remove build/
clean:
	rm -rf $(BUILD)

## help: this list; also BUILD=, CC=, CXX=, OPT=, HDT_DATA=
help:
	@sed -n 's/^## /  /p' $(firstword $(MAKEFILE_LIST))

# what the build needs is there
$(READY): tools/deps
	@mkdir -p $(@D)
	@tools/deps
	@touch $@

compile = @mkdir -p $(@D) && echo "  $(1) $<" && $(2) $(OPT) $(3) $(INC) $(DEP) -c $< -o $@
$(BUILD)/obj/ctrl/%.c.o: ctrl/%.c | $(READY)
	$(call compile,CC ,$(CC),-std=c99 -ffreestanding -fPIC $(CWARN))
$(BUILD)/obj/driver/%.c.o: driver/%.c | $(READY)
	$(call compile,CC ,$(CC),-std=c99 -D_POSIX_C_SOURCE=200809L -fPIC $(CWARN))
$(BUILD)/obj/sim/%.c.o: sim/%.c | $(READY)
	$(call compile,CC ,$(CC),-std=c99 $(CWARN))
$(BUILD)/obj/%.cpp.o: %.cpp | $(READY)
	$(call compile,CXX,$(CXX),-std=c++17 $(WARN) -isystem /usr/include/eigen3 -DEIGEN_MPL2_ONLY)
$(BUILD)/obj/tests/%.c.o: tests/%.c | $(READY)
	$(call compile,CC ,$(CC),-std=gnu99 -Wall -Wextra -Werror -Wno-sign-compare)
$(BUILD)/obj/tests/%.cpp.o: tests/%.cpp | $(READY)
	$(call compile,CXX,$(CXX),-std=c++17 -Wall -Wextra -Werror -isystem /usr/include/eigen3 -DEIGEN_MPL2_ONLY)
$(BUILD)/obj/tools/%.c.o: tools/%.c | $(READY)
	$(call compile,CC ,$(CC),-std=gnu99 $(WARN))

# the tests hold the driver's log to LCM's own library and to the code its generator writes
$(BUILD)/gen/hdt_cycle_t.h $(BUILD)/gen/hdt_cycle_t.c $(BUILD)/gen/hdt_run_t.h $(BUILD)/gen/hdt_run_t.c &: driver/hdt_cycle.lcm | $(READY)
	@mkdir -p $(BUILD)/gen
	lcm-gen -c --c-cpath $(BUILD)/gen --c-hpath $(BUILD)/gen $<
# and `hdt` publishes and reads the loop's status with it
$(BUILD)/gen/hdt_status_t.h $(BUILD)/gen/hdt_status_t.c &: driver/hdt_status.lcm | $(READY)
	@mkdir -p $(BUILD)/gen
	lcm-gen -c --c-cpath $(BUILD)/gen --c-hpath $(BUILD)/gen $<
$(call obj,tools/hdt_telemetry.cpp tools/hdt_top.cpp): $(BUILD)/gen/hdt_status_t.h
$(BUILD)/obj/gen/%.o: $(BUILD)/gen/%.c
	@mkdir -p $(@D)
	$(CC) $(OPT) -std=gnu99 -w $(INC) -c $< -o $@

$(BUILD)/libhdt.a: $(CTRL) $(DRIVER)
	@rm -f $@ && echo "  AR  $@" && ar rcs $@ $^
$(BUILD)/libhdt.map: driver/libhdt.symbols
	@mkdir -p $(@D) && { echo '{ global:'; sed '/^#/d; s/$$/;/' $<; echo 'local: *; };'; } >$@
$(BUILD)/libhdt.so.$(VERSION): $(CTRL) $(DRIVER) $(BUILD)/libhdt.map
	@echo "  LD  $@" && $(CC) $(OPT) -shared -Wl,-soname,libhdt.so.$(SOMAJOR) -Wl,--version-script=$(BUILD)/libhdt.map \
	  -o $@ $(CTRL) $(DRIVER)
$(BUILD)/librig.a: $(SIM) $(MODEL)
	@rm -f $@ && echo "  AR  $@" && ar rcs $@ $^
$(BUILD)/hdt: $(TOOLS) $(STATUS) $(LIBS)
	@echo "  LD  $@" && $(CXX) $(OPT) -o $@ $(TOOLS) $(STATUS) $(LIBS) $(LINK)
$(BUILD)/obj/tests/check_log.c.o $(BUILD)/obj/tests/lcm_dump.c.o: $(BUILD)/gen/hdt_cycle_t.h
$(BUILD)/tests/check_log: $(LCMGEN)
$(BUILD)/obj/tests/check_telemetry.cpp.o: $(BUILD)/gen/hdt_cycle_t.h $(BUILD)/gen/hdt_status_t.h
$(BUILD)/tests/check_telemetry: $(BUILD)/obj/tests/check_telemetry.cpp.o $(LCMGEN) $(STATUS) $(LIBS) | $(BUILD)/hdt
	@mkdir -p $(@D) && echo "  LD  $@" && $(CXX) $(OPT) -o $@ $(filter %.o,$^) $(LIBS) $(CHECK) $(LINK)
$(BUILD)/gen/fmu_arm.c: $(BUILD)/fmu_gen model/arms/pa10.toml
	@mkdir -p $(BUILD)/gen && $< model/arms/pa10.toml hdt_pa10 $(BUILD)/gen
$(BUILD)/tests/check_fmu $(BUILD)/tests/fmu_direct: $(BUILD)/obj/gen/fmu_arm.o
$(BUILD)/fmu_gen: $(call obj,tools/fmu_gen.cpp) $(filter %/hdt_rig.cpp.o %/hdt_effects.cpp.o,$(TOOLS)) $(LIBS)
	@echo "  LD  $@" && $(CXX) $(OPT) -o $@ $^ $(LINK)
# effects by name are tools
$(BUILD)/tests/check_plant_effects: $(BUILD)/obj/tests/check_plant_effects.cpp.o \
    $(filter %/hdt_rig.cpp.o %/hdt_effects.cpp.o,$(TOOLS)) $(LIBS)
	@mkdir -p $(@D) && echo "  LD  $@" && $(CXX) $(OPT) -o $@ $(filter %.o,$^) $(LIBS) $(CHECK) $(LINK)
# the experiments of `hdt paper` are tools, all but the command itself
$(BUILD)/tests/check_paper: $(BUILD)/obj/tests/check_paper.cpp.o $(filter-out %/hdt_paper.cpp.o,$(filter \
    %/hdt_rig.cpp.o %/hdt_effects.cpp.o %/hdt_world.cpp.o $(BUILD)/obj/tools/hdt_paper%,$(TOOLS))) $(LIBS)
	@mkdir -p $(@D) && echo "  LD  $@" && $(CXX) $(OPT) -o $@ $(filter %.o,$^) $(LIBS) $(CHECK) $(LINK)
$(BUILD)/bench_diagnosis: $(call obj,$(wildcard tools/bench_diagnosis*.cpp)) $(LIBS)
	@echo "  LD  $@" && $(CXX) $(OPT) -o $@ $^ $(LINK)
$(BUILD)/tests/check_bench_diagnosis: $(BUILD)/obj/tests/check_bench_diagnosis.cpp.o \
    $(call obj,$(filter-out %_main.cpp,$(wildcard tools/bench_diagnosis*.cpp))) \
    $(filter %/hdt_rig.cpp.o %/hdt_effects.cpp.o,$(TOOLS)) $(LIBS) | $(BUILD)/hdt
	@mkdir -p $(@D) && echo "  LD  $@" && $(CXX) $(OPT) -o $@ $(filter %.o,$^) $(LIBS) $(CHECK) $(LINK)
$(BUILD)/bench_ident: $(call obj,tools/bench_ident.cpp tools/hdt_paper_fit.cpp) $(LIBS)
	@echo "  LD  $@" && $(CXX) $(OPT) -o $@ $^ $(LINK)
$(BUILD)/measured_page: $(call obj,$(wildcard tools/measured_*.cpp)) $(LIBS)
	@echo "  LD  $@" && $(CXX) $(OPT) -o $@ $^ $(LINK)
$(BUILD)/tests/check_measured: $(BUILD)/obj/tests/check_measured.cpp.o $(BUILD)/obj/tools/measured_signals.cpp.o $(LIBS)
	@mkdir -p $(@D) && echo "  LD  $@" && $(CXX) $(OPT) -o $@ $(filter %.o,$^) $(LIBS) $(CHECK) $(LINK)
$(BUILD)/tests/rt_shim.so: tests/rt_shim.c | $(READY)
	@mkdir -p $(@D) && $(CC) -O1 -std=gnu99 -Wall -Wextra -Werror -shared -fPIC -o $@ $<
$(BUILD)/tests/rt_probe: tests/rt_probe.c | $(READY)
	@mkdir -p $(@D) && $(CC) -O1 -std=gnu99 -Wall -Wextra -Werror -o $@ $< -lpthread
$(BUILD)/tests/check_rt: | $(BUILD)/hdt $(BUILD)/tests/rt_shim.so $(BUILD)/tests/rt_probe
$(BUILD)/tests/check_plugin: | $(BUILD)/libhdt.so.$(VERSION)
$(BUILD)/tests/check_bus $(BUILD)/tests/check_cycle: $(BUILD)/obj/tests/broken_bus.c.o
# the LinuxCNC component, in a HAL of the test's
$(BUILD)/obj/tests/check_hal.c.o: INC += -Itests/hal
$(BUILD)/tests/%: $(BUILD)/obj/tests/%.c.o $(LIBS)
	@mkdir -p $(@D) && echo "  LD  $@" && $(CXX) $(OPT) -o $@ $(filter %.o,$^) $(LIBS) $(CHECK) $(LINK)
$(BUILD)/tests/%: $(BUILD)/obj/tests/%.cpp.o $(LIBS)
	@mkdir -p $(@D) && echo "  LD  $@" && $(CXX) $(OPT) -o $@ $< $(LIBS) $(CHECK) $(LINK)
$(BUILD)/bench_%: $(BUILD)/obj/tools/bench_%.c.o $(LIBS)
	@echo "  LD  $@" && $(CXX) $(OPT) -o $@ $< $(LIBS) $(LINK)

-include $(shell find $(BUILD)/obj -name '*.d' 2>/dev/null)
