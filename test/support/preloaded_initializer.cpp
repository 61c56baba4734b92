// SPDX-License-Identifier: BSD-3-Clause
// A library with an initializer of its own, for LD_PRELOAD: "mine" does what "coarse" does.
#include "dsorb/init/initializer.h"
#include "dsorb/init/registry.h"

namespace dsorb {
namespace {

const RegisteredInitializer kMine("mine",
                                  [](const InitializerOptions& options, const auto& camera) {
                                    InitializerOptions coarse = options;
                                    coarse.kind = InitializerKind::kCoarse;
                                    return makeInitializer(coarse, camera);
                                  });

}  // namespace
}  // namespace dsorb
