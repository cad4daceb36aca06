// SPDX-License-Identifier: Apache-2.0
//
// `hdt export`: the arm as URDF or MJCF.
#include <memory>

#include "model/export.hpp"
#include "model/files.hpp"
#include "tools/hdt_cli.hpp"
#include "tools/hdt_rig.hpp"

namespace hdt::cli {

namespace {

struct ExportArguments {
    std::string arm, format, out;
    ExportOptions options;
};

ExportFormat format_of(const std::string &text)
{
    if (text == "urdf")
        return ExportFormat::Urdf;
    if (text == "mjcf")
        return ExportFormat::Mjcf;
    throw UsageError("--format: expected urdf or mjcf, found \"" + text + "\"");
}

int run_export(const ExportArguments &a)
{
    const hdt_arm arm = rig::load_arm(a.arm);
    write_file(a.out, export_text(arm, format_of(a.format), a.options));
    std::printf("%s: %s, %d joints%s\n", a.out.c_str(), arm.name, arm.joints,
                a.options.kinematics ? ", without masses" : "");
    return Ok;
}

} // namespace

void add_export(CLI::App &app, int &code)
{
    auto a = std::make_shared<ExportArguments>();
    CLI::App *sub = app.add_subcommand("export", "the rigid arm for other simulators: URDF or MJCF (MuJoCo)");
    sub->add_option("arm", a->arm, "model file")->required();
    sub->add_option("--format", a->format, "urdf or mjcf")->required();
    sub->add_option("--out", a->out, "file to write")->required();
    sub->add_flag("--armature", a->options.armature, "mjcf: with rotor inertia at each joint");
    sub->add_flag("--kinematics", a->options.kinematics, "urdf: without masses, for an arm that has none");
    sub->callback([a, &code] { code = run_export(*a); });
}

} // namespace hdt::cli
