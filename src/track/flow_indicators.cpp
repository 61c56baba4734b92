// SPDX-License-Identifier: BSD-3-Clause
#include "track/flow_indicators.h"

#include <algorithm>

namespace dsorb::track {
namespace {

constexpr std::size_t kFlowStride = 32;  // [points]
constexpr double kFlowMinDepth = 0.01;  // of the depth in the reference; nearer points have no flow
constexpr double kFlowPrior = 0.1;      // added to the number of flow samples

/// Adds the squared image displacement of a pixel that moves to the ray q.
/// @return false where the ray passes the camera plane
bool addDisplacement(const PinholeCamera& camera,
                     const Eigen::Vector2d& pixel,
                     const Eigen::Vector3d& q,
                     double& sum) {
  if (!(q.z() > kFlowMinDepth)) return false;
  const double diagonal2 = static_cast<double>(camera.width) * camera.width +
                           static_cast<double>(camera.height) * camera.height;
  sum += std::min((camera.project(q) - pixel).squaredNorm(), diagonal2);
  return true;
}

}  // namespace

FlowIndicators flowIndicators(const ReferencePoints& points,
                              const PinholeCamera& camera,
                              const SE3& T_cur_ref) {
  const Eigen::Matrix3d R = T_cur_ref.rotationMatrix();
  double translation_sum = 0;
  double full_sum = 0;
  int translation_count = 0;
  int full_count = 0;
  for (std::size_t i = 0; i < points.size(); i += kFlowStride) {
    const Eigen::Vector3d ray(points.ray_x[i], points.ray_y[i], 1.0);
    const Eigen::Vector2d pixel = camera.project(ray);
    const Eigen::Vector3d shift =
        static_cast<double>(points.inverse_depth[i]) * T_cur_ref.translation();
    for (const double sign : {1.0, -1.0}) {
      translation_count += addDisplacement(camera, pixel, ray + sign * shift, translation_sum);
      full_count += addDisplacement(camera, pixel, R * ray + sign * shift, full_sum);
    }
  }
  return {translation_sum / (translation_count + kFlowPrior), full_sum / (full_count + kFlowPrior)};
}

}  // namespace dsorb::track
