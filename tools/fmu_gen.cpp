// SPDX-License-Identifier: Apache-2.0
//
// From a model file: the C source that compiles the arm into an FMU, and its modelDescription.xml.
// usage: fmu_gen ARM.toml IDENTIFIER DIRECTORY    writes fmu_arm.c and modelDescription.xml into DIRECTORY,
// which is there already
//
// Owns: the XML and the C source.  The variables are those of sim/fmu_table.c, and only those.
// Never: a date, or anything else that makes two runs differ.
#include <cmath>
#include <cstdio>
#include <cstring>
#include <string>

#include "ctrl/hdt.h"
#include "model/arm_file.hpp"
#include "model/files.hpp"
#include "model/text.hpp"
#include "sim/fmu.h"
#include "sim/servo.h"
#include "tools/hdt_rig.hpp"

namespace {

using hdt::InputError;
using hdt::markup_escaped;
using hdt::number17;

std::string c_string(const std::string &text)
{
    std::string out = "\"";
    for (char c : text)
        out += c == '"' || c == '\\' ? std::string("\\") + c : std::string(1, c);
    return out + "\"";
}

std::string version()
{
    return std::to_string(HDT_VERSION_MAJOR) + "." + std::to_string(HDT_VERSION_MINOR) + "." +
           std::to_string(HDT_VERSION_PATCH);
}

// Binary and XML of one build have it, no other's.
std::string token(const hdt_arm &arm)
{
    return "hdt-" + version() + "-" + std::to_string(sizeof(plant_model)) + "-" +
           hdt::hex(arm.digest, sizeof arm.digest);
}

bool is_plain(const std::string &name)
{
    for (std::size_t i = 0; i < name.size(); i++) {
        const char c = name[i];
        const bool letter = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_';
        if (!letter && !(i > 0 && c >= '0' && c <= '9'))
            return false;
    }
    return !name.empty();
}

// As structured names have it: a name that is no identifier goes in quotes.
std::string variable_name(const hdt_arm &arm, const fmu_kind &kind, int joint)
{
    if (!kind.per_joint)
        return kind.name;
    const std::string name = arm.joint[joint].name;
    if (is_plain(name))
        return name + "." + kind.name;
    std::string quoted = "'";
    for (char c : name)
        quoted += c == '\'' || c == '\\' || c == '"' ? std::string("\\") + c : std::string(1, c);
    return quoted + "'." + kind.name;
}

// ---- modelDescription.xml ----

std::string start_text(const fmu_arm &described, const fmu_kind &kind, int joint)
{
    fmu_values values;
    fmu_defaults(&described, &values);
    const void *at = fmu_at(&values, &kind, joint);
    switch (kind.type) {
    case FMU_FLOAT64: return number17(*static_cast<const double *>(at));
    case FMU_UINT16: return std::to_string(*static_cast<const uint16_t *>(at));
    case FMU_UINT64: return std::to_string(*static_cast<const uint64_t *>(at));
    case FMU_BOOLEAN: return *static_cast<const bool *>(at) ? "true" : "false";
    case FMU_ENUMERATION: break;
    }
    return std::to_string(*static_cast<const int64_t *>(at));
}

std::string limits_text(const plant_model &plant, const fmu_kind &kind, int joint)
{
    double min, max;
    std::string text;
    if (!fmu_limits(&plant, &kind, joint, &min, &max) ||
        kind.type == FMU_ENUMERATION) // its items are its limits
        return text;
    if (std::isfinite(min))
        text += " min=\"" + number17(min) + "\"";
    if (std::isfinite(max))
        text += " max=\"" + number17(max) + "\"";
    return text;
}

std::string variable_xml(const hdt_arm &arm, const plant_model &plant, const fmu_arm &described, unsigned row,
                         int joint)
{
    static const char *const type[] = {"Float64", "UInt16", "UInt64", "Boolean", "Enumeration"};
    static const char *const causality[] = {"independent", "parameter", "input", "output"};
    static const char *const variability[] = {"fixed", "discrete", "continuous"};
    const fmu_kind &kind = *fmu_row(row);
    std::string x = std::string("    <") + type[kind.type] + " name=\"" +
    markup_escaped(variable_name(arm, kind, joint)) +
                    "\" valueReference=\"" + std::to_string(fmu_reference(row, joint)) + "\" causality=\"" +
                    causality[kind.causality] + "\" variability=\"" + variability[kind.variability] + "\"";
    if (kind.type == FMU_ENUMERATION)
        x += " declaredType=\"Mode\"";
    if (kind.unit)
        x += std::string(" unit=\"") + kind.unit + "\"";
    if (kind.causality == FMU_OUTPUT)
        x += " initial=\"calculated\"";
    else if (kind.causality != FMU_INDEPENDENT)
        x += " start=\"" + start_text(described, kind, joint) + "\"" + limits_text(plant, kind, joint);
    return x + " description=\"" + markup_escaped(kind.description) + "\"/>\n";
}

// One line for every variable `line` has something to say about.
template <typename Line>
std::string for_each_variable(const hdt_arm &arm, Line line)
{
    std::string x;
    for (unsigned row = 0; fmu_row(row) != nullptr; row++)
        for (int joint = 0; joint < (fmu_row(row)->per_joint ? arm.joints : 1); joint++)
            x += line(row, joint);
    return x;
}

std::string structure_line(const char *element, unsigned row, int joint, const char *more)
{
    if (fmu_row(row)->causality != FMU_OUTPUT)
        return "";
    return std::string("    <") + element + " valueReference=\"" +
    std::to_string(fmu_reference(row, joint)) + "\"" +
           more + "/>\n";
}

std::string description_xml(const hdt_arm &arm, const plant_model &plant, const fmu_arm &described,
                            const std::string &identifier)
{
    std::string x = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n"
                    "<fmiModelDescription fmiVersion=\"3.0\" modelName=\"" + markup_escaped(arm.name) +
                    "\" instantiationToken=\"" + described.token + "\"\n  description=\"Harmonic-drive arm " +
                    markup_escaped(arm.name) + " with its servo driver\" version=\"" + version() +
                    "\" generationTool=\"hdt " + version() + "\" variableNamingConvention=\"structured\">\n";
    x += "  <CoSimulation modelIdentifier=\"" + identifier +
         "\" canHandleVariableCommunicationStepSize=\"true\" canGetAndSetFMUState=\"true\" "
         "canSerializeFMUState=\"true\"\n    fixedInternalStepSize=\"" + number17(1.0 / SERVO_RATE_HZ) +
         "\"/>\n";
    x += "  <UnitDefinitions>\n"
         "    <Unit name=\"s\"><BaseUnit s=\"1\"/></Unit>\n"
         "    <Unit name=\"kg\"><BaseUnit kg=\"1\"/></Unit>\n"
         "    <Unit name=\"m\"><BaseUnit m=\"1\"/></Unit>\n"
         "    <Unit name=\"rad\"><BaseUnit rad=\"1\"/></Unit>\n"
         "    <Unit name=\"rad/s\"><BaseUnit rad=\"1\" s=\"-1\"/></Unit>\n"
         "    <Unit name=\"N.m\"><BaseUnit kg=\"1\" m=\"2\" s=\"-2\"/></Unit>\n"
         "  </UnitDefinitions>\n"
         "  <TypeDefinitions>\n"
         "    <EnumerationType name=\"Mode\" description=\"what an axis does\">\n";
    static const char *const modes[] = {"brake", "velocity", "torque"};
    for (int m = FMU_BRAKE; m <= FMU_TORQUE; m++)
        x += std::string("      <Item name=\"") + modes[m] + "\" value=\"" + std::to_string(m) + "\"/>\n";
    x += "    </EnumerationType>\n"
         "  </TypeDefinitions>\n"
         "  <LogCategories>\n"
         "    <Category name=\"logStatusError\" description=\"calls and values refused\"/>\n"
         "    <Category name=\"logStatusDiscard\" description=\"values out of their limits\"/>\n"
         "    <Category name=\"logAlarms\" description=\"alarms of the servo driver\"/>\n"
         "  </LogCategories>\n"
         "  <DefaultExperiment startTime=\"0\" stopTime=\"2\" stepSize=\"0.005\"/>\n"
         "  <ModelVariables>\n";
    x += for_each_variable(arm, [&](unsigned row, int joint) {
        return variable_xml(arm, plant, described, row, joint);
    });
    x += "  </ModelVariables>\n  <ModelStructure>\n";
    // an output is of the end of a step: what is set after it does not change it
    x += for_each_variable(arm, [](unsigned row, int joint) {
        return structure_line("Output", row, joint, " dependencies=\"\"");
    });
    x += for_each_variable(arm, [](unsigned row, int joint) { return structure_line("InitialUnknown", row,
                                                                                    joint, ""); });
    return x + "  </ModelStructure>\n</fmiModelDescription>\n";
}

// ---- fmu_arm.c ----

std::string list(const double *values, int n)
{
    std::string x = "{ ";
    for (int i = 0; i < n; i++)
        x += (i == 0 ? "" : ", ") + number17(values[i]);
    return x + " }";
}

std::string arm_source(const fmu_arm &described, const plant_model &plant)
{
    std::string x = "/* Generated by fmu_gen " + version() + " (" + described.token + ").  Do not edit. */\n"
                    "#include \"sim/fmu.h\"\n\n"
                    "/* the bytes below are of the struct plant_model the generator was built with */\n"
                    "typedef char fmu_plant_has_the_size_it_had[sizeof(struct plant_model) == " +
                    std::to_string(sizeof plant) + " ? 1 : -1];\n\n"
                    "const struct fmu_arm fmu_the_arm = {\n    .name = " + c_string(described.name) +
                    ",\n    .token = " +
                    c_string(described.token) + ",\n    .joints = " + std::to_string(described.joints) +
                    ",\n    .joint = { ";
    for (int j = 0; j < described.joints; j++)
        x += (j == 0 ? "" : ", ") + c_string(described.joint[j]);
    x += " },\n    .flange_m = " + list(described.flange_m, 3) + ",\n    .flange_rot = " +
    list(described.flange_rot, 9) +
         ",\n    .payload_kg = " + number17(described.payload_kg) + ",\n    .payload_m = " +
         list(described.payload_m, 3) +
         ",\n};\n\nconst union fmu_plant fmu_the_plant = { .byte = {";
    unsigned char bytes[sizeof plant];
    std::memcpy(bytes, &plant, sizeof plant);
    for (std::size_t i = 0; i < sizeof bytes; i++)
        x += (i % 20 == 0 ? "\n    " : " ") + std::to_string(bytes[i]) + ",";
    return x + "\n} };\n";
}

void generate(const std::string &path, const std::string &identifier, const std::string &directory)
{
    if (!is_plain(identifier))
        throw InputError("fmu_gen: expected an identifier of letters, digits and _, found \"" + identifier +
                         "\"");
    const hdt_arm arm = hdt::rig::load_arm(path);
    if (arm.joints > DRV_AXES)
        throw InputError(path + ": expected at most " + std::to_string(DRV_AXES) +
                         " joints, as the servo driver has "
                         "axes, found " + std::to_string(arm.joints));
    const plant_model plant = hdt::rig::plant_from_arm(arm, 0);
    const std::string mark = token(arm);
    fmu_arm described = {};
    described.name = arm.name;
    described.token = mark.c_str();
    described.joints = arm.joints;
    for (int j = 0; j < arm.joints; j++)
        described.joint[j] = arm.joint[j].name;
    std::memcpy(described.flange_m, arm.flange_m, sizeof described.flange_m);
    std::memcpy(described.flange_rot, arm.flange_rot, sizeof described.flange_rot);
    described.payload_kg = arm.payload_kg;
    std::memcpy(described.payload_m, arm.payload_com_m, sizeof described.payload_m);
    hdt::write_file(directory + "/fmu_arm.c", arm_source(described, plant));
    hdt::write_file(directory + "/modelDescription.xml", description_xml(arm, plant, described, identifier));
}

} // namespace

int main(int argc, char **argv)
{
    if (argc != 4) {
        std::fprintf(stderr, "usage: fmu_gen ARM.toml IDENTIFIER DIRECTORY\n");
        return 2;
    }
    try {
        generate(argv[1], argv[2], argv[3]);
    } catch (const std::exception &e) {
        std::fprintf(stderr, "%s\n", e.what());
        return 3;
    }
    return 0;
}
