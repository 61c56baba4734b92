// SPDX-License-Identifier: BSD-3-Clause
#include "init/variants.h"

#include "dsorb/error.h"
#include "dsorb/options/initializer.h"

#include "init/orb/thesis/with_ceres.h"
#include "init/registry.h"

#include <algorithm>

namespace dsorb {
namespace {

/// First version of [Gladkova]: geometry only, solved by Ceres.
OrbOptions gladkovaGeometry() {
  OrbOptions orb;
  orb.min_frames = 5;
  orb.max_frames = 20;
  orb.min_tracked = 50;
  orb.reference_interval = 0;
  orb.tracks.flow = OpticalFlow::kOpenCv;
  orb.tracks.min_eigenvalue = 0.1;  // OpenCV's 1e-4
  orb.tracks.max_corners = 2000;
  orb.tracks.corner_quality = 0.01;
  orb.tracks.max_level = 3;
  orb.motion = MotionMethod::kGladkova;
  orb.geometric.solver = AdjustmentSolver::kCeres;
  orb.geometric.sigma = 1;
  orb.geometric.loss = RobustLoss::kHuber;
  orb.geometric.loss_threshold = 2.4474;  // sqrt(5.99): 95 % of chi-square, 2 degrees of freedom
  orb.semi_dense.image_noise = 6.3246;    // sigma_i^2 = 40, equation 7
  orb.semi_dense.fusion = DepthFusion::kProduct;
  orb.semi_dense.max_points = 0;
  orb.photometric.enabled = false;
  orb.remove_moving = false;
  return orb;
}

/// Second version: photometric adjustment of everything, patches scaled by psi.
OrbOptions gladkovaPhotometry() {
  OrbOptions orb = gladkovaGeometry();
  orb.photometric.enabled = true;
  orb.photometric.solver = AdjustmentSolver::kCeres;
  orb.photometric.brightness = PhotometricBrightness::kPsiFixed;
  orb.photometric.poses = PhotometricPoses::kFree;
  orb.photometric.gradient_weights = false;  // equation 11
  orb.photometric.max_frames = 0;
  orb.photometric.joint_points = 0;
  orb.photometric.max_iterations = 10;
  orb.outlier_rule = OutlierRule::kNone;
  return orb;
}

/// Third version: outlier filter and second adjustment.
OrbOptions gladkovaFiltered() {
  OrbOptions orb = gladkovaPhotometry();
  orb.outlier_rule = OutlierRule::kPixelVotes;
  return orb;
}

/// Xingwei Qu's variant: descriptors between two frames, the model with the most inliers.
OrbOptions matching() {
  OrbOptions orb = gladkovaGeometry();
  orb.front_end = OrbFrontEnd::kDescriptors;
  orb.tracks.flow = OpticalFlow::kDsorb;  // for images out of focus only
  orb.model_choice = ModelChoice::kInliers;
  return orb;
}

bool contains(const std::vector<std::string>& names, const std::string& name) {
  return std::find(names.begin(), names.end(), name) != names.end();
}

}  // namespace

std::vector<std::string> builtInVariants() {
  return {"coarse", "orb", "orb-v1", "orb-v2", "orb-v3", "orb-matching"};
}

std::vector<std::string> initializerVariants() {
  std::vector<std::string> names = {"coarse", "orb"};
  if (init_orb::builtWithCeres()) names = builtInVariants();
  const std::vector<std::string> registered = registeredInitializers();
  names.insert(names.end(), registered.begin(), registered.end());
  return names;
}

void throwUnknownVariant(const std::string& name) {
  std::string text = "initializer '" + name + "': this version has";
  if (contains(builtInVariants(), name)) {
    text =
        "initializer '" + name + "' needs a build with Ceres (DSORB_WITH_CERES=ON); this one has";
  }
  for (const std::string& variant : initializerVariants()) text += " " + variant;
  throw ConfigError(text);
}

InitializerOptions initializerVariant(const std::string& name) {
  if (!contains(initializerVariants(), name)) throwUnknownVariant(name);
  InitializerOptions options;
  if (!contains(builtInVariants(), name)) {
    options.kind = InitializerKind::kRegistered;
    options.registered = name;
  }
  if (name == "coarse") options.kind = InitializerKind::kCoarse;
  if (name == "orb-v1") options.orb = gladkovaGeometry();
  if (name == "orb-v2") options.orb = gladkovaPhotometry();
  if (name == "orb-v3") options.orb = gladkovaFiltered();
  if (name == "orb-matching") options.orb = matching();
  return options;
}

}  // namespace dsorb
