// SPDX-License-Identifier: BSD-3-Clause
// A direct system of the shape of DSO, in small and of our own: keyframes with a state, points with
// inverse depth, prior and host, one call for each image. It is started by our initializer;
// docs/integrate.md explains it.
#pragma once

#include <Eigen/Dense>
#include <dsorb/init/initializer.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <memory>
#include <optional>
#include <vector>

namespace direct {

// [types]
/// A frame of the window. Its state is pose and brightness; `at_start` is where derivatives are
/// taken.
struct KeyframeState {
  dsorb::FramePtr image;
  dsorb::SE3 T_cam_world;
  dsorb::SE3 T_cam_world_at_start;
  dsorb::AffineBrightness affine;
};

/// A point of the window.
struct ActivePoint {
  std::size_t host = 0;           // index into the keyframes
  Eigen::Vector2d pixel;          // in the host
  double inverse_depth = 0;       // in the host
  double inverse_depth_zero = 0;  // where derivatives are taken
  double prior = 0;               // information of inverse_depth_zero [grey levels^2 unit^2]
};

struct PosedImage {
  double timestamp;
  dsorb::SE3 T_cam_world;
};
// [/types]

// [rehost]
struct HostedDepth {
  Eigen::Vector2d pixel;
  double inverse_depth;
  double variance;
};

/// The same point as seen by a keyframe, for hosts that do not become one: with z' = (R ray).z /
/// rho + t.z the new inverse depth is rho / ((R ray).z + t.z rho), and the variance goes with the
/// square of its derivative.
inline std::optional<HostedDepth> rehost(const dsorb::InitPoint& point,
                                         const dsorb::SE3& T_keyframe_host,
                                         const dsorb::PinholeCamera& camera) {
  const Eigen::Vector3d ray = camera.unproject(point.pixel.cast<double>());
  const Eigen::Vector3d turned = T_keyframe_host.rotationMatrix() * ray;
  const double rho = point.inverse_depth;
  const Eigen::Vector3d scaled =
      turned + rho * T_keyframe_host.translation();  // rho times the point
  if (scaled.z() < 0.1) return std::nullopt;         // behind the keyframe, or nearly so
  const Eigen::Vector2d pixel = camera.project(scaled);
  if (!camera.contains(pixel, 4)) return std::nullopt;
  const double slope = turned.z() / (scaled.z() * scaled.z());
  return HostedDepth{pixel, rho / scaled.z(), slope * slope * point.variance};
}
// [/rehost]

// [prior]
// Our systems' photometric Hessian counts squared grey levels without dividing by their noise, so a
// variance becomes information times the variance of a grey value. No start is trusted without
// limit: its errors are not independent.
constexpr double kGreyVariance = 8;  // [grey levels^2]
constexpr double kMaxPrior = 2500;   // sigma of 0.057 at inverse depth 1

inline double priorOf(double variance) {
  return std::min(kGreyVariance / variance, kMaxPrior);
}
// [/prior]

class DirectSystem {
 public:
  explicit DirectSystem(const dsorb::PinholeCamera& camera)
      : camera_(camera),
        initializer_(dsorb::makeInitializer(dsorb::InitializerOptions(), camera)) {}

  // [add]
  void addActiveFrame(const dsorb::FramePtr& image) {
    if (keyframes_.empty()) {
      const dsorb::InitStep step = initializer_->addFrame(image);
      if (step.result) start(*step.result);
    } else {
      track(image);
    }
  }
  // [/add]

  [[nodiscard]] const std::vector<PosedImage>& trajectory() const { return trajectory_; }
  [[nodiscard]] const std::vector<KeyframeState>& keyframes() const { return keyframes_; }
  [[nodiscard]] const std::vector<ActivePoint>& points() const { return points_; }
  [[nodiscard]] double trackingRms() const { return tracking_rms_; }

 private:
  // [start]
  void start(const dsorb::InitializationResult& result) {
    // Reference and newest frame become keyframes. World: the reference camera; unit: its points'
    // mean inverse depth is 1. For another unit s, multiply translations by s, divide inverse
    // depths by s and variances by s^2.
    for (const dsorb::PosedFrame* posed : {&result.frames.front(), &result.frames.back()}) {
      keyframes_.push_back({posed->frame, *posed->T_cam_ref, *posed->T_cam_ref, posed->affine});
    }
    for (const dsorb::InitPoint& point : result.points) addPoint(result, point);
    // Frames between are posed but hold no state: they end in the trajectory. A system that still
    // traces candidate points feeds them through its tracing now, in this order.
    for (const dsorb::PosedFrame& posed : result.frames) {
      if (posed.T_cam_ref) trajectory_.push_back({posed.frame->timestamp(), *posed.T_cam_ref});
    }
    affine_ = result.frames.back().affine;
  }

  void addPoint(const dsorb::InitializationResult& result, const dsorb::InitPoint& point) {
    const auto host = static_cast<std::size_t>(point.host);
    if (host == 0 || host + 1 == result.frames.size()) {
      const double rho = point.inverse_depth;
      const std::size_t keyframe = host == 0 ? 0 : 1;
      points_.push_back({keyframe, point.pixel.cast<double>(), rho, rho, priorOf(point.variance)});
      return;
    }
    const dsorb::SE3 T_ref_host = result.frames[host].T_cam_ref->inverse();
    if (const auto moved = rehost(point, T_ref_host, camera_)) {
      const double rho = moved->inverse_depth;
      points_.push_back({0, moved->pixel, rho, rho, priorOf(moved->variance)});
    }
  }
  // [/start]

  /// Grey level and gradient between pixels.
  static Eigen::Vector3d sample(const dsorb::PyramidLevel& level, const Eigen::Vector2d& p) {
    const int u = static_cast<int>(p.x()), v = static_cast<int>(p.y());
    const double a = p.x() - u, b = p.y() - v;
    const auto value = [&](int du, int dv) {
      const dsorb::ImageSample s = level.at(u + du, v + dv);
      return Eigen::Vector3d(s.intensity, s.dx, s.dy);
    };
    return (1 - b) * ((1 - a) * value(0, 0) + a * value(1, 0)) +
           b * ((1 - a) * value(0, 1) + a * value(1, 1));
  }

  struct NormalEquations {
    Eigen::Matrix<double, 7, 7> H = Eigen::Matrix<double, 7, 7>::Zero();  // pose, brightness b
    Eigen::Matrix<double, 7, 1> g = Eigen::Matrix<double, 7, 1>::Zero();
    double energy = 0;
    int count = 0;
  };

  /// One point's residual and derivatives, with Huber weights.
  void addResidual(const ActivePoint& point,
                   const dsorb::Frame& image,
                   int level,
                   const dsorb::SE3& T_cam_world,
                   double offset,
                   NormalEquations& sums) const {
    const KeyframeState& host = keyframes_[point.host];
    const dsorb::PinholeCamera camera = camera_.atLevel(level);
    const double scale = 1.0 / (1 << level);
    const Eigen::Vector2d in_host = (point.pixel.array() + 0.5) * scale - 0.5;
    const dsorb::SE3 T = T_cam_world * host.T_cam_world.inverse();
    const Eigen::Vector3d p = T * (camera.unproject(in_host) / point.inverse_depth);
    if (p.z() < 0.05 || !camera.contains(in_host, 2) || !camera.contains(camera.project(p), 2))
      return;
    const Eigen::Vector3d seen = sample(image.level(level), camera.project(p));
    const auto transfer = dsorb::brightnessTransfer(
        host.affine, host.image->exposure(), {affine_.a, offset}, image.exposure());
    const double grey = sample(host.image->level(level), in_host)[0];
    const double residual = seen[0] - transfer.gain * grey - transfer.offset;
    const double weight = std::min(1.0, 9 / std::max(std::abs(residual), 1e-9));
    const Eigen::Vector3d gradient(
        seen[1] * camera.fx / p.z(),
        seen[2] * camera.fy / p.z(),
        -(seen[1] * camera.fx * p.x() + seen[2] * camera.fy * p.y()) / (p.z() * p.z()));
    Eigen::Matrix<double, 7, 1> J;
    J << gradient, p.cross(gradient), -1;
    sums.H += weight * J * J.transpose();
    sums.g += weight * residual * J;
    sums.energy += weight * (2 - weight) * residual * residual;
    ++sums.count;
  }

  NormalEquations equations(const dsorb::Frame& image,
                            int level,
                            const dsorb::SE3& T_cam_world,
                            double offset) const {
    NormalEquations sums;
    for (const ActivePoint& point : points_) {
      addResidual(point, image, level, T_cam_world, offset, sums);
    }
    return sums;
  }

  /// Direct alignment from coarse to fine, from constant motion.
  void track(const dsorb::FramePtr& image) {
    const dsorb::SE3& last = trajectory_.back().T_cam_world;
    const dsorb::SE3& before = trajectory_[trajectory_.size() - 2].T_cam_world;
    dsorb::SE3 pose = last * before.inverse() * last;
    for (int level = std::min(3, image->pyramid().levels() - 1); level >= 0; --level) {
      for (int i = 0; i < 10; ++i) {
        NormalEquations sums = equations(*image, level, pose, affine_.b);
        sums.H.diagonal() *= 1 + 1e-4;
        const Eigen::Matrix<double, 7, 1> step = -sums.H.ldlt().solve(sums.g);
        pose = dsorb::SE3::exp(step.head<6>()) * pose;
        affine_.b += step[6];
        if (step.norm() < 1e-6) break;
      }
    }
    const NormalEquations last_sums = equations(*image, 0, pose, affine_.b);
    tracking_rms_ = std::sqrt(last_sums.energy / std::max(last_sums.count, 1));
    trajectory_.push_back({image->timestamp(), pose});
  }

  dsorb::PinholeCamera camera_;
  std::unique_ptr<dsorb::Initializer> initializer_;
  std::vector<KeyframeState> keyframes_;
  std::vector<ActivePoint> points_;
  std::vector<PosedImage> trajectory_;
  dsorb::AffineBrightness affine_;
  double tracking_rms_ = 0;
};

}  // namespace direct
