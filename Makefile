# SPDX-License-Identifier: Apache-2.0
# The only build file.  `make help` lists the targets.

BUILD   ?= build
PREFIX  ?= /usr/local
DESTDIR ?=
CC      ?= cc
CXX     ?= c++
OPT     ?= -O2 -g
HDT_DATA ?= ../shared/data
export HDT_DATA

VERSION := $(shell awk '/define HDT_VERSION_(MAJOR|MINOR|PATCH)/{v=v s $$3; s="."} END{print v}' ctrl/hdt.h)
SOMAJOR := $(firstword $(subst ., ,$(VERSION)))

# build with every core unless told otherwise
ifeq ($(filter -j%,$(MAKEFLAGS)),)
MAKEFLAGS += -j$(shell nproc 2>/dev/null || echo 2)
endif

WARN := -Wall -Wextra -Wpedantic -Wconversion -Wshadow -Werror
CWARN := $(WARN) -Wstrict-prototypes -Wmissing-prototypes
INC  := -I. -I$(BUILD)/gen
DEP   = -MMD -MP
ctrl_FLAGS   := -std=c99 -ffreestanding -fPIC $(CWARN)
driver_FLAGS := -std=c99 -D_POSIX_C_SOURCE=200809L -fPIC $(CWARN)
sim_FLAGS    := -std=c99 $(CWARN)
CXXFLAGS_    := -std=c++17 $(WARN) -isystem /usr/include/eigen3 -DEIGEN_MPL2_ONLY

obj = $(patsubst %,$(BUILD)/obj/%.o,$(1))
CTRL   := $(call obj,$(wildcard ctrl/*.c))
DRIVER := $(call obj,$(wildcard driver/*.c))
SIM    := $(call obj,$(wildcard sim/*.c))
MODEL  := $(call obj,$(wildcard model/*.cpp))
TOOLS  := $(call obj,$(wildcard tools/hdt*.cpp))
TESTS  := $(patsubst tests/%.c,$(BUILD)/tests/%,$(wildcard tests/check_*.c)) \
          $(patsubst tests/%.cpp,$(BUILD)/tests/%,$(wildcard tests/check_*.cpp))

.PHONY: all demo check bench install clean help deps check-layers
.DELETE_ON_ERROR:
.SECONDARY:

## all: libraries and build/hdt
all: $(BUILD)/libhdt.a $(BUILD)/libhdt.so.$(VERSION) $(BUILD)/hdt

help:
	@sed -n 's/^## /  /p' $(MAKEFILE_LIST)

$(BUILD)/obj/ctrl/%.c.o: ctrl/%.c
	@mkdir -p $(@D)
	$(CC) $(OPT) $(ctrl_FLAGS) $(INC) $(DEP) -c $< -o $@
$(BUILD)/obj/driver/%.c.o: driver/%.c
	@mkdir -p $(@D)
	$(CC) $(OPT) $(driver_FLAGS) $(INC) $(DEP) -c $< -o $@
$(BUILD)/obj/sim/%.c.o: sim/%.c
	@mkdir -p $(@D)
	$(CC) $(OPT) $(sim_FLAGS) $(INC) $(DEP) -c $< -o $@
$(BUILD)/obj/%.cpp.o: %.cpp
	@mkdir -p $(@D)
	$(CXX) $(OPT) $(CXXFLAGS_) $(INC) $(DEP) -c $< -o $@
$(BUILD)/obj/tests/%.c.o: tests/%.c
	@mkdir -p $(@D)
	$(CC) $(OPT) -std=gnu99 -Wall -Wextra -Werror -Wno-sign-compare $(INC) $(DEP) -c $< -o $@

$(BUILD)/libhdt.a: $(CTRL) $(DRIVER)
	@rm -f $@
	ar rcs $@ $^
$(BUILD)/libhdt.so.$(VERSION): $(CTRL) $(DRIVER)
	$(CC) -shared -Wl,-soname,libhdt.so.$(SOMAJOR) -o $@ $^ -llcm
$(BUILD)/librig.a: $(SIM) $(MODEL)
	@rm -f $@
	ar rcs $@ $^
LIBS := $(BUILD)/librig.a $(BUILD)/libhdt.a
$(BUILD)/hdt: $(TOOLS) $(LIBS)
	$(CXX) $(OPT) -o $@ $(TOOLS) $(LIBS) -llcm -lpthread -lm
$(BUILD)/tests/%: $(BUILD)/obj/tests/%.c.o $(LIBS)
	@mkdir -p $(@D)
	$(CXX) $(OPT) -o $@ $< $(LIBS) -lcheck_pic -lsubunit -lrt -llcm -lpthread -lm
$(BUILD)/tests/%: $(BUILD)/obj/tests/%.cpp.o $(LIBS)
	@mkdir -p $(@D)
	$(CXX) $(OPT) -o $@ $< $(LIBS) -lcheck_pic -lsubunit -lrt -llcm -lpthread -lm

## clean: remove build/
clean:
	rm -rf $(BUILD)

-include $(shell find $(BUILD)/obj -name '*.d' 2>/dev/null)
