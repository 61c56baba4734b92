// SPDX-License-Identifier: BSD-3-Clause
#include "io/output/frame_table.h"

#include "io/output/run_record.h"

#include <fmt/format.h>

#include <cmath>

namespace dsorb::io {
namespace {

constexpr int kPoseColumns = 7;         // translation and quaternion
constexpr int kCovarianceColumns = 21;  // upper triangle of 6 x 6

/// Text as RFC 4180 has it: in quotes where it holds a comma, a quote or a line break.
std::string csvField(const std::string& text) {
  if (text.find_first_of(",\"\r\n") == std::string::npos) return text;
  std::string field = "\"";
  for (const char c : text) field += c == '"' ? std::string("\"\"") : std::string(1, c);
  return field + "\"";
}

std::string poseFields(const std::optional<SE3>& pose) {
  if (!pose || !isFinite(*pose)) return std::string(kPoseColumns, ',');
  const Eigen::Vector3d& t = pose->translation();
  const auto& q = pose->unitQuaternion();
  return fmt::format(",{:.9f},{:.9f},{:.9f},{:.9f},{:.9f},{:.9f},{:.9f}",
                     t.x(),
                     t.y(),
                     t.z(),
                     q.x(),
                     q.y(),
                     q.z(),
                     q.w());
}

std::string covarianceFields(const std::optional<Matrix6d>& covariance) {
  if (!covariance || !covariance->allFinite()) return std::string(kCovarianceColumns, ',');
  std::string fields;
  for (int row = 0; row < 6; ++row) {
    for (int column = row; column < 6; ++column) {
      fields += fmt::format(",{:.6e}", (*covariance)(row, column));
    }
  }
  return fields;
}

}  // namespace

std::string frameTableHeader() {
  std::string header =
      "index,timestamp,state,milliseconds,is_keyframe,tracking_rmse,segment,image,keyframe,rel_tx,"
      "rel_ty,rel_tz,rel_qx,rel_qy,rel_qz,rel_qw";
  for (const char* prefix : {"cov", "world_cov"}) {
    for (int row = 0; row < 6; ++row) {
      for (int column = row; column < 6; ++column) {
        header += fmt::format(",{}_{}{}", prefix, row, column);
      }
    }
  }
  return header + "\n";
}

std::string frameTableLine(const FrameEstimate& estimate,
                           double milliseconds,
                           const std::string& image_file) {
  const double rmse = estimate.tracking_rmse.value_or(-1);
  return fmt::format(
      "{},{:.9f},{},{:.3f},{},{},{},{},{}{}{}{}\n",
      estimate.frame->id().value,
      estimate.frame->timestamp(),
      name(estimate.state),
      milliseconds,
      estimate.is_keyframe ? 1 : 0,
      std::isfinite(rmse) && rmse >= 0 ? fmt::format("{:.4f}", static_cast<float>(rmse)) : "",
      estimate.segment,
      csvField(image_file),
      estimate.keyframe ? fmt::to_string(estimate.keyframe->value) : "",
      poseFields(estimate.T_cam_keyframe),
      covarianceFields(estimate.covariance),
      covarianceFields(estimate.world_covariance));
}

}  // namespace dsorb::io
