// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/frame_priors.h"
#include "dsorb/init/initializer.h"
#include "dsorb/io/sequence_reader.h"

#include "base/median.h"
#include "support/depth_windows.h"
#include "support/matchers.h"

#include <Eigen/Geometry>
#include <opencv2/imgcodecs.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

namespace dsorb {

/// A sequence with its truth.
struct DepthSequence {
  PinholeCamera camera;
  BrightnessModel brightness = BrightnessModel::kUncalibrated;
  std::vector<FramePtr> frames;
  std::vector<std::vector<float>> depth;  // [m]
  std::vector<SE3> T_world_cam;
};

inline DepthSequence readDepthSequence(const std::string& path,
                                       std::optional<Readout> readout = {}) {
  SequenceOptions options;
  options.path = path;
  options.readout = readout;
  SequenceReader reader(options);
  DepthSequence sequence{
      reader.camera(), reader.brightness(), {}, {}, readTruth(path + "/groundtruth.txt")};
  while (const auto next = reader.next()) {
    sequence.frames.push_back(next->frame);
    const auto name = std::filesystem::path(next->image_file).stem().string();
    const cv::Mat image = cv::imread(path + "/depth/" + name + ".png", cv::IMREAD_UNCHANGED);
    if (image.empty() || image.cols != reader.camera().width ||
        image.rows != reader.camera().height) {
      throw std::runtime_error("no depth of the images' size: " + path);
    }
    auto& depth = sequence.depth.emplace_back();
    for (int y = 0; y < image.rows; ++y) {
      for (int x = 0; x < image.cols; ++x) {
        depth.push_back(static_cast<float>(image.at<std::uint16_t>(y, x)) * 1e-3F);
      }
    }
  }
  return sequence;
}

/// How known depths, and known rotations since the frame before, are made of true ones.
struct DepthErrors {
  std::string name;
  bool known = true;
  double claimed = 1;   // over the errors' sigma
  double outliers = 0;  // share
  bool mirrored = false;
  int step = 1;             // every so many pixels
  double turn_sigma = 0;    // of a rotation [rad]; 0: none is known
  double turn_claimed = 1;  // over its errors' sigma, also of the translation
  double move_sigma = 0;    // of a translation, over its length [-]; 0: none is known
  bool backwards = false;   // the translation is
};

/// @param motion true translation, rotation with its error
inline PosePrior posePrior(FrameId since,
                           const SE3& motion,
                           const DepthErrors& wrong,
                           std::mt19937& random) {
  const double turn_sigma = wrong.turn_sigma * wrong.turn_claimed;
  if (wrong.move_sigma == 0) return rotationSince(since, motion.rotationMatrix(), turn_sigma);
  constexpr double kLeast = 1e-4;  // [m]
  const double sigma = std::max(kLeast, wrong.move_sigma * motion.translation().norm());
  std::normal_distribution<double> error(0, sigma);
  Eigen::Vector3d t = wrong.backwards ? Eigen::Vector3d(-motion.translation())
                                      : Eigen::Vector3d(motion.translation());
  for (double& value : t) value += error(random);
  Matrix6d covariance = Matrix6d::Zero();
  covariance.diagonal().head<3>().setConstant(std::pow(sigma * wrong.turn_claimed, 2));
  covariance.diagonal().tail<3>().setConstant(turn_sigma * turn_sigma);
  return poseSince(since, SE3(Eigen::Quaterniond(motion.unitQuaternion()), t), covariance);
}

inline FramePtr withDepth(const DepthSequence& sequence,
                          std::size_t i,
                          const DepthErrors& wrong,
                          double sigma) {
  const Frame& frame = *sequence.frames[i];
  const int width = frame.width();
  std::vector<float> pixels;
  for (int y = 0; y < frame.height(); ++y) {
    for (int x = 0; x < width; ++x) pixels.push_back(frame.level(0).at(x, y).intensity);
  }
  std::mt19937 random(static_cast<unsigned>(i) + 1);
  std::normal_distribution<float> noise(0, static_cast<float>(sigma));
  std::uniform_real_distribution<float> uniform(0, 1);
  std::vector<float> depth(pixels.size(), 0);
  for (int y = 0; y < frame.height(); y += wrong.step) {
    for (int x = 0; x < width; x += wrong.step) {
      const int from = wrong.mirrored ? width - 1 - x : x;
      float value = sequence.depth[i][static_cast<std::size_t>(y * width + from)];
      value *= 1 + noise(random);
      if (uniform(random) < static_cast<float>(wrong.outliers)) value *= .3F + 2 * uniform(random);
      depth[static_cast<std::size_t>(y * width + x)] = value;
    }
  }
  FrameInfo info{frame.id(), frame.timestamp(), frame.exposure()};
  if (frame.rowTimes()) info.row_times = std::make_shared<RowTimes>(*frame.rowTimes());
  auto priors = std::make_shared<FramePriors>();
  if (wrong.known) {
    priors->depth = denseDepth({depth.data(), width, frame.height()}, 0, sigma * wrong.claimed);
  }
  if (wrong.turn_sigma > 0 && i > 0) {
    const SE3 turn = sequence.T_world_cam[i].inverse() * sequence.T_world_cam[i - 1];
    std::normal_distribution<double> error(0, wrong.turn_sigma);
    const Eigen::Vector3d omega{error(random), error(random), error(random)};
    const SE3 found(so3Exp(omega) * turn.unitQuaternion(), turn.translation());
    priors->pose = posePrior(sequence.frames[i - 1]->id(), found, wrong, random);
  }
  info.priors = priors;
  return Frame::create({pixels.data(), width, frame.height()}, info);
}

struct DepthStart {
  double frames = NAN, direction = NAN, depth = NAN, scale = NAN, sigma = NAN, used = 0;
  double inflation = NAN, ate = NAN;
};

inline void compare(const InitializationResult& result,
                    const DepthSequence& sequence,
                    DepthStart& outcome) {
  const auto reference = static_cast<std::size_t>(result.frames.front().frame->id().value);
  const auto newest = static_cast<std::size_t>(result.frames.back().frame->id().value);
  const SE3 truth = sequence.T_world_cam[newest].inverse() * sequence.T_world_cam[reference];
  const Eigen::Vector3d moved = result.frames.back().T_cam_ref->translation();
  outcome.direction = directionErrorDeg(moved, truth.translation());
  std::vector<double> ratios;
  for (const InitPoint& point : result.points) {
    const auto x = static_cast<int>(std::lround(point.pixel.x()));
    const auto y = static_cast<int>(std::lround(point.pixel.y()));
    const auto at = static_cast<std::size_t>(y * sequence.camera.width + x);
    const double depth = sequence.depth[reference][at];
    if (depth > 0) ratios.push_back(depth * point.inverse_depth);
  }
  const double scale = medianOf(ratios);
  for (double& ratio : ratios) ratio = std::abs(ratio / scale - 1);
  outcome.depth = medianOf(ratios);
  if (result.metric) {
    outcome.scale = result.metric->metres / scale - 1;
    outcome.sigma = result.metric->relative_sigma;
  }
  if (result.report.depth_prior) {
    outcome.used = *result.report.depth_prior ? 1 : 0;
    outcome.inflation = *result.report.detail("known_depth_inflation");
  }
  if (result.report.pose_prior) outcome.used = *result.report.pose_prior ? 1 : 0;
}

}  // namespace dsorb
