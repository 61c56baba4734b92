// SPDX-License-Identifier: BSD-3-Clause
// What a build without OpenCV's dnn module has in place of learned_network.cpp.
#include "dsorb/error.h"

#include "init/orb/tracks/learned_features.h"

namespace dsorb::init_orb {

bool builtWithDnn() {
  return false;
}

std::unique_ptr<FeatureFinder> makeLearnedFinder(const std::string& file) {
  throw ConfigError("feature network " + file +
                    ": needs a build with OpenCV's dnn module (DSORB_WITH_DNN=ON)");
}

}  // namespace dsorb::init_orb
