// SPDX-License-Identifier: BSD-3-Clause
// Whether to believe a start, for systems with a window of their own: what their first adjustment
// made of it is compared with what was handed over. The adjustment here is a stand-in that refines
// inverse depths alone; docs/integrate.md explains the rest.
#include "images.h"

#include <dsorb/init/initializer.h>
#include <dsorb/init/start_judge.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <optional>
#include <vector>

namespace {

struct AdjustedPoint {
  double inverse_depth = 0;  // 0: dropped
  double information = 0;    // sum of squared derivatives of the residuals [grey levels^2 unit^2]
  double energy = 0;         // sum of squared residuals
  int residuals = 0;
};

struct AdjustedWindow {
  std::vector<dsorb::SE3> T_cam_ref;  // of the start's frames that are keyframes
  std::vector<AdjustedPoint> points;  // in the order of the start's points
  double noise = 0;                   // standard deviation of a residual [grey levels]
};

// [judge]
/// @return why the start is to be thrown away; nothing: it stays
std::optional<dsorb::RefusalReason> judge(const dsorb::InitializationResult& start,
                                          const AdjustedWindow& window) {
  std::vector<dsorb::StartPose> poses;
  for (std::size_t k = 1; k < window.T_cam_ref.size(); ++k) {  // the reference is at rest
    poses.push_back({*start.frames[k].T_cam_ref, window.T_cam_ref[k]});
  }
  const double noise = std::min(window.noise, dsorb::kMaxStartNoise);
  std::vector<dsorb::StartPoint> points;
  for (std::size_t i = 0; i < start.points.size(); ++i) {
    const AdjustedPoint& adjusted = window.points[i];
    points.push_back({start.points[i].inverse_depth, start.points[i].variance, 0, 0});
    if (!(adjusted.inverse_depth > 0)) continue;  // dropped: this counts as well
    points.back().adjusted = adjusted.inverse_depth;
    points.back().adjusted_variance = noise * noise / adjusted.information;
  }
  return dsorb::refusalOf(dsorb::startChange(poses, points));
}
// [/judge]

/// Grey level and gradient between pixels.
Eigen::Vector3d sample(const dsorb::Frame& frame, const Eigen::Vector2d& p) {
  const int u = static_cast<int>(p.x()), v = static_cast<int>(p.y());
  const double a = p.x() - u, b = p.y() - v;
  const auto value = [&](int du, int dv) {
    const dsorb::ImageSample s = frame.level(0).at(u + du, v + dv);
    return Eigen::Vector3d(s.intensity, s.dx, s.dy);
  };
  return (1 - b) * ((1 - a) * value(0, 0) + a * value(1, 0)) +
         b * ((1 - a) * value(0, 1) + a * value(1, 1));
}

/// Adds the residuals of a pixel and its four neighbours in one frame. @return the gradient's sum
double addResiduals(const dsorb::InitializationResult& start,
                    const dsorb::InitPoint& point,
                    std::size_t frame,
                    const dsorb::PinholeCamera& camera,
                    AdjustedPoint& sums) {
  constexpr int kPattern[5][2] = {{0, 0}, {2, 0}, {-2, 0}, {0, 2}, {0, -2}};
  const dsorb::PosedFrame& host = start.frames[static_cast<std::size_t>(point.host)];
  const dsorb::PosedFrame& target = start.frames[frame];
  const dsorb::SE3 T = *target.T_cam_ref * host.T_cam_ref->inverse();
  const auto transfer = dsorb::brightnessTransfer(
      host.affine, host.frame->exposure(), target.affine, target.frame->exposure());
  double gradient = 0;
  for (const auto& offset : kPattern) {
    const Eigen::Vector2d pixel =
        point.pixel.cast<double>() + Eigen::Vector2d(offset[0], offset[1]);
    const Eigen::Vector3d p =
        T.rotationMatrix() * camera.unproject(pixel) + sums.inverse_depth * T.translation();
    if (p.z() < 0.05 || !camera.contains(pixel, 2) || !camera.contains(camera.project(p), 2))
      continue;
    const Eigen::Vector3d seen = sample(*target.frame, camera.project(p));
    const double grey = sample(*host.frame, pixel)[0];
    const double residual = seen[0] - transfer.gain * grey - transfer.offset;
    const Eigen::Vector3d t = T.translation();
    const double slope = seen[1] * camera.fx * (t.x() * p.z() - t.z() * p.x()) / (p.z() * p.z()) +
                         seen[2] * camera.fy * (t.y() * p.z() - t.z() * p.y()) / (p.z() * p.z());
    gradient += slope * residual;
    sums.information += slope * slope;
    sums.energy += residual * residual;
    ++sums.residuals;
  }
  return gradient;
}

/// Stands for the first adjustment of a window: poses stay, each inverse depth is refined.
AdjustedWindow adjust(const dsorb::InitializationResult& start,
                      const dsorb::PinholeCamera& camera) {
  constexpr double kOutlierRms = 12;  // [grey levels]
  AdjustedWindow window;
  for (const dsorb::PosedFrame& posed : start.frames) {
    window.T_cam_ref.push_back(posed.T_cam_ref.value_or(dsorb::SE3()));
  }
  double energy = 0;
  int residuals = 0;
  for (const dsorb::InitPoint& point : start.points) {
    AdjustedPoint adjusted;
    adjusted.inverse_depth = point.inverse_depth;
    for (int i = 0; i < 5; ++i) {
      AdjustedPoint sums{adjusted.inverse_depth, 0, 0, 0};
      double gradient = 0;
      for (std::size_t k = 1; k < start.frames.size(); ++k) {
        if (start.frames[k].T_cam_ref) gradient += addResiduals(start, point, k, camera, sums);
      }
      adjusted = sums;
      if (sums.information > 0) adjusted.inverse_depth -= gradient / sums.information;
    }
    const bool kept = adjusted.residuals > 0 && adjusted.inverse_depth > 0 &&
                      std::sqrt(adjusted.energy / adjusted.residuals) < kOutlierRms;
    energy += kept ? adjusted.energy : 0;
    residuals += kept ? adjusted.residuals : 0;
    window.points.push_back(kept ? adjusted : AdjustedPoint());
  }
  window.noise = std::sqrt(energy / std::max(residuals, 1));
  return window;
}

/// Near and far exchanged.
dsorb::InitializationResult exchanged(dsorb::InitializationResult start) {
  for (dsorb::InitPoint& point : start.points) {
    const float squared = point.inverse_depth * point.inverse_depth;
    point.variance /= squared * squared;
    point.inverse_depth = 1 / point.inverse_depth;
  }
  return start;
}

const char* answer(const std::optional<dsorb::RefusalReason>& refused) {
  return refused ? dsorb::name(*refused) : "stays";
}

}  // namespace

int main() {
  const dsorb::PinholeCamera camera{kFocal, kFocal, kWidth / 2.0, kHeight / 2.0, kWidth, kHeight};
  const auto initializer = dsorb::makeInitializer(dsorb::InitializerOptions(), camera);
  for (int i = 0; i < 30; ++i) {
    const auto pixels = grabImage(i);
    const auto step = initializer->addFrame(dsorb::Frame::create(
        dsorb::ImageView(pixels.data(), kWidth, kHeight), {dsorb::FrameId{i}, i / 30.0}));
    if (!step.result) continue;
    const dsorb::InitializationResult wrong = exchanged(*step.result);
    const auto right = judge(*step.result, adjust(*step.result, camera));
    const auto refused = judge(wrong, adjust(wrong, camera));
    std::printf("the start: %s; with near and far exchanged: %s\n", answer(right), answer(refused));
    return !right && refused ? 0 : 1;
  }
  return std::puts("not initialized"), 1;
}
