// SPDX-License-Identifier: BSD-3-Clause
// Stands for a fork of a direct system, in small and of our own, with the habits of the real ones:
// it deletes frames, takes whole pixels only, has a depth prior that damps and never pulls and
// counts 600^2 times in the marginalization, brightness the other way round, 0 where an image shows
// nothing, and it is reset by being deleted.
#pragma once

#include <Eigen/Dense>
#include <dsorb/init/direct_start.h>

#include <map>
#include <memory>
#include <optional>
#include <vector>

namespace fork {

using Pose = Eigen::Isometry3d;  // world to camera
using Vector8 = Eigen::Matrix<double, 8, 1>;
using Grey = Eigen::Vector3f;  // intensity and its gradient

using Brightness = Eigen::Vector2d;  // gain and offset: exp(gain) I + offset is the same in all

/// Record of an image. It stays, the image does not.
struct Shell {
  int number = 0;
  bool valid = false;  // is posed
  Pose pose = Pose::Identity();
  Brightness brightness = Brightness::Zero();
};

struct Level {
  int width = 0, height = 0;
  std::vector<Grey> pixels;
};

/// An image in use: a keyframe, or the newest.
struct Frame {
  Frame(Shell* record, const float* image, int width, int height);
  ~Frame() { --alive; }
  Frame(Frame&&) = delete;
  Shell* shell;
  std::vector<Level> levels;
  Pose& pose;  // both of the record
  Brightness& brightness;
  static int alive;
};

struct Point {
  Frame* host = nullptr;
  int u = 0, v = 0;
  double inverse_depth = 1;
  bool has_prior = false;
  double information = 0;  // of the last adjustment, the prior included
};

struct Equations {
  Eigen::MatrixXd H;
  Eigen::VectorXd b;
};

struct Start;  // what dsorb is told of all this

class System {
 public:
  /// @param refusals of starts in a row: not a member, which would be deleted with the system
  System(const dsorb::PinholeCamera& camera,
         const dsorb::InitializerOptions& initializer,
         const dsorb::DirectStartOptions& options,
         int& refusals);
  ~System();

  /// @param image width times height grey levels, 0 where there is none
  void addActiveFrame(const float* image);

  int early = 9;             // images after a start, every third of which becomes a keyframe
  bool init_failed = false;  // to be deleted
  double rms = 0;            // of the last adjustment [grey levels]
  std::vector<std::unique_ptr<Shell>> history;
  std::vector<std::unique_ptr<Frame>> window;
  std::map<int, Point> points;  // by number

 private:
  friend struct Start;
  struct Residual {
    double value, weight, depth;     // depth: derivative by the inverse depth
    Eigen::Matrix<double, 16, 1> J;  // by target and host
  };
  struct Link {  // of a point's inverse depth with the keyframes
    Eigen::Matrix<double, Eigen::Dynamic, 1, 0, 64, 1> frames;
    double gradient, information, energy;
    int residuals;
  };

  bool residual(const Point& at, const Frame& to, int level, const int* d, Residual& r) const;
  Link link(const Point& point, double prior, Equations* sums) const;
  std::optional<Eigen::Vector3d> seen(const Point& point, const Frame& frame) const;
  int addPoint(const Point& point);
  void makeKeyframe(std::unique_ptr<Frame> frame);
  void track(Frame& frame);
  bool needsKeyframe(const Frame& frame) const;
  void optimise();
  void marginalise();
  void activate();

  dsorb::PinholeCamera camera_;
  std::unique_ptr<Start> glue_;
  std::unique_ptr<dsorb::DirectStart<Start>> start_;
  Equations prior_;                   // of what was marginalised
  int next_point_ = 0, started_ = 0;  // the latter: number of the image
};

}  // namespace fork
