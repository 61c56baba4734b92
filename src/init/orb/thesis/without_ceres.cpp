// SPDX-License-Identifier: BSD-3-Clause
// What a build without Ceres has in place of thesis/ceres and tracks/opencv_flow.cpp.
// makeInitializer refuses options that lead here.
#include "init/orb/bundle/robust_adjustment.h"
#include "init/orb/photometric/photometric_solvers.h"
#include "init/orb/thesis/with_ceres.h"
#include "init/orb/tracks/opencv_flow.h"

#include <stdexcept>

namespace dsorb::init_orb {
namespace {

[[noreturn]] void refuse() {
  throw std::logic_error("this build has no Ceres (DSORB_WITH_CERES=OFF)");
}

}  // namespace

bool builtWithCeres() {
  return false;
}

std::optional<int> solveWithCeres(InitialMap& /*map*/,
                                  const PinholeCamera& /*camera*/,
                                  const GeometricOptions& /*options*/,
                                  const Stopping& /*stopping*/) {
  refuse();
}

std::optional<PhotometricSolve> solvePhotometricWithCeres(const PhotometricProblem& /*problem*/,
                                                          const PhotometricOptions& /*options*/,
                                                          PhotometricState& /*state*/) {
  refuse();
}

std::vector<unsigned char> followWithOpenCv(const cv::Mat& /*from*/,
                                            const cv::Mat& /*to*/,
                                            const std::vector<cv::Point2f>& /*start*/,
                                            const LucasKanadeOptions& /*options*/,
                                            std::vector<cv::Point2f>& /*end*/) {
  refuse();
}

}  // namespace dsorb::init_orb
