// SPDX-License-Identifier: BSD-3-Clause
#include "self_calibration/shaped_patch.h"

#include "base/lanes.h"
#include "base/target_clones.h"

#include <Eigen/LU>

namespace dsorb::self_calibration {
namespace {

constexpr float kScharr = 1.0F / 32;
constexpr int kMostSteps = 12;
constexpr float kLeastStep = 0.01F;     // [px]
constexpr float kLeastShaping = 0.1F;   // of the shape, at the border [px]
constexpr float kMostUnlike = 0.2F;     // differences' share of the variance of a patch
constexpr float kMostStretched = 2.5F;  // area, or its inverse

/// Interpolates a row of a patch.
/// @param begin first place [px] @param step from one to the next
DSORB_ALWAYS_INLINE void sampleRow(const FlowLevel& image,
                                   const Eigen::Vector2f& begin,
                                   const Eigen::Vector2f& step,
                                   float* row) {
  const float* origin = image.memory.data() + image.origin;
  const auto stride = static_cast<int>(image.stride);
  for (int i = 0; i < kPatchSide; ++i) {
    const float x = begin[0] + static_cast<float>(i) * step[0];
    const float y = begin[1] + static_cast<float>(i) * step[1];
    const auto px = static_cast<int>(x);
    const auto py = static_cast<int>(y);
    const float fx = x - static_cast<float>(px);
    const float fy = y - static_cast<float>(py);
    const int at = py * stride + px;
    const float upper = origin[at] + fx * (origin[at + 1] - origin[at]);
    const float lower = origin[at + stride] + fx * (origin[at + stride + 1] - origin[at + stride]);
    row[i] = upper + fy * (lower - upper);
  }
}

/// What the rows of a patch sum up to, before lanes are added.
struct LaneSums {
  Lanes e = {}, squares = {};
  Lanes dx = {}, dx_u = {}, dx_v = {};
  Lanes dy = {}, dy_u = {}, dy_v = {};
};

DSORB_TARGET_CLONES void sumDifferences(const FlowLevel& image,
                                        const PatchPose& pose,
                                        const float* const (&patch)[3],
                                        LaneSums& sums) {
  float row[kPatchStride] = {};
  const Eigen::Vector2f step = pose.shape.col(0);
  std::ptrdiff_t at = 0;
  for (int v = -kPatchReach; v <= kPatchReach; ++v) {
    const Eigen::Vector2f begin =
        pose.place - kPatchReach * step + static_cast<float>(v) * pose.shape.col(1);
    sampleRow(image, begin, step, row);
    Lanes dx = {}, dy = {};
    for (int k = 0; k < kPatchStride; k += kLanes, at += kLanes) {
      Lanes u;
      for (int i = 0; i < kLanes; ++i) u[i] = static_cast<float>(k + i - kPatchReach);
      const Lanes e = load(row + k) - load(patch[0] + at);
      sums.e += e;
      sums.squares += e * e;
      const Lanes gx = e * load(patch[1] + at);
      const Lanes gy = e * load(patch[2] + at);
      dx += gx;
      dy += gy;
      sums.dx_u += u * gx;
      sums.dy_u += u * gy;
    }
    sums.dx += dx;
    sums.dy += dy;
    sums.dx_v += static_cast<float>(v) * dx;
    sums.dy_v += static_cast<float>(v) * dy;
  }
}

}  // namespace

/// Differences of an image from a patch, means taken out.
struct ShapedPatch::Difference {
  bool inside = false;
  Vector6f by_pose;   // with the slopes of the patch, summed
  float squares = 0;  // summed
};

bool isInside(const FlowLevel& image, const PatchPose& pose) {
  const Eigen::Vector2f reach = kPatchReach * pose.shape.cwiseAbs().rowwise().sum();
  const Eigen::Vector2f end(static_cast<float>(image.width - 2),
                            static_cast<float>(image.height - 2));
  return (pose.place - reach).minCoeff() >= 0 && (end - pose.place - reach).minCoeff() >= 0;
}

ShapedPatch::ShapedPatch(const FlowLevel& image, const Eigen::Vector2f& middle) {
  const auto x = static_cast<int>(middle.x());
  const auto y = static_cast<int>(middle.y());
  float sum = 0;
  Eigen::Matrix<float, 6, 6> H = Eigen::Matrix<float, 6, 6>::Zero();
  for (int v = -kPatchReach; v <= kPatchReach; ++v) {
    const float* above = image.row(y + v - 1) + x;
    const float* row = image.row(y + v) + x;
    const float* below = image.row(y + v + 1) + x;
    for (int u = -kPatchReach; u <= kPatchReach; ++u) {
      const int cell = (v + kPatchReach) * kPatchStride + u + kPatchReach;
      const auto at = static_cast<std::size_t>(cell);
      const float dx = kScharr * (3 * (above[u + 1] - above[u - 1] + below[u + 1] - below[u - 1]) +
                                  10 * (row[u + 1] - row[u - 1]));
      const float dy = kScharr * (3 * (below[u - 1] - above[u - 1] + below[u + 1] - above[u + 1]) +
                                  10 * (below[u] - above[u]));
      const auto fu = static_cast<float>(u), fv = static_cast<float>(v);
      Vector6f slope;
      slope << dx, dy, dx * fu, dx * fv, dy * fu, dy * fv;
      value_[at] = row[u];
      dx_[at] = dx;
      dy_[at] = dy;
      sum += row[u];
      variance_ += row[u] * row[u];
      slopes_ += slope;
      H.noalias() += slope * slope.transpose();
    }
  }
  constexpr float kPixels = kPatchSide * kPatchSide;
  variance_ -= sum * sum / kPixels;
  H -= slopes_ * slopes_.transpose() / kPixels;
  H.diagonal() *= 1.0001F;
  information_.compute(H);
}

ShapedPatch::Difference ShapedPatch::compare(const FlowLevel& image, const PatchPose& pose) const {
  Difference difference;
  difference.inside = isInside(image, pose);
  if (!difference.inside) return difference;
  LaneSums sums;
  sumDifferences(image, pose, {value_.data(), dx_.data(), dy_.data()}, sums);
  const float mean = sumLanes(sums.e) / (kPatchSide * kPatchSide);
  difference.by_pose << sumLanes(sums.dx), sumLanes(sums.dy), sumLanes(sums.dx_u),
      sumLanes(sums.dx_v), sumLanes(sums.dy_u), sumLanes(sums.dy_v);
  difference.by_pose -= mean * slopes_;
  difference.squares = sumLanes(sums.squares) - mean * mean * (kPatchSide * kPatchSide);
  return difference;
}

bool ShapedPatch::align(const FlowLevel& image, PatchPose& pose) const {
  if (information_.info() != Eigen::Success) return false;
  for (int i = 0; i < kMostSteps; ++i) {
    const Difference difference = compare(image, pose);
    if (!difference.inside) return false;
    const Vector6f step = information_.solve(difference.by_pose);
    if (!step.allFinite()) return false;
    Eigen::Matrix2f change;
    change << step[2], step[3], step[4], step[5];
    pose.shape *= (Eigen::Matrix2f::Identity() + change).inverse();
    const Eigen::Vector2f move = pose.shape * step.head<2>();
    pose.place -= move;
    const float area = pose.shape.determinant();
    if (!(area < kMostStretched && area * kMostStretched > 1)) return false;
    if (move.norm() < kLeastStep && kPatchReach * change.norm() < kLeastShaping)
      return difference.squares < kMostUnlike * variance_;
  }
  return false;
}

}  // namespace dsorb::self_calibration
