// SPDX-License-Identifier: BSD-3-Clause
#include "fork.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>

namespace fork {

constexpr double kDepthPrior = 2500;  // of a point with a prior, damping only

// [glue]
/// What dsorb::DirectStart needs to know of the fork.
struct Start {
  using Frame = Shell*;
  using Point = int;

  void posed(Shell* shell, const dsorb::PosedFrame& posed) const {
    shell->valid = true;
    shell->pose = Pose(posed.T_cam_ref->matrix());
    const dsorb::AffineBrightness& affine = posed.affine;  // brightness the other way round
    shell->brightness = Brightness(-affine.a, -affine.b * std::exp(-affine.a));
  }
  fork::Frame* makeFrame(Shell* shell, const dsorb::PosedFrame&, const float* pixels) const {
    return new fork::Frame(shell, pixels, system.camera_.width, system.camera_.height);
  }
  void addKeyframe(fork::Frame* frame) const { system.window.emplace_back(frame); }
  int addPoint(fork::Frame* host, int u, int v, const dsorb::StartDepth& depth) const {
    return system.addPoint({host, u, v, depth.inverse_depth, true});
  }
  dsorb::SE3 pose(const fork::Frame* frame) const {
    return dsorb::SE3::fromMatrix(frame->pose.matrix());
  }
  dsorb::AdjustedDepth depth(int number) const {
    const auto point = system.points.find(number);
    if (point == system.points.end()) return {};  // it was deleted
    return {point->second.inverse_depth, point->second.information - kDepthPrior};
  }

  System& system;
};
// [/glue]

namespace {

constexpr int kPattern[8][2] = {
    {0, -2}, {-1, -1}, {1, -1}, {-2, 0}, {0, 0}, {2, 0}, {-1, 1}, {0, 2}};
constexpr double kHuber = 9;      // [grey levels]
constexpr double kGradient = 50;  // pixels of stronger gradients count less [grey levels / px]
constexpr double kOutlier = 8 * 12 * 12;      // energy of a pattern
const Eigen::Vector2d kBrightness(1e7, 1e2);  // information that it stays as it is
constexpr std::size_t kMaxKeyframes = 6;
constexpr int kCell = 20;               // width of a cell with a new point [px]
constexpr double kKeyframeFlow = .025;  // over width and height

/// Bilinear; false beside the image.
bool sample(const Level& level, double x, double y, Grey& grey) {
  if (!(x >= 1 && y >= 1 && x < level.width - 2 && y < level.height - 2)) return false;
  const int u = static_cast<int>(x), v = static_cast<int>(y);
  const float a = static_cast<float>(x - u), b = static_cast<float>(y - v);
  const Grey* p = &level.pixels[v * level.width + u];
  const Grey* below = p + level.width;
  grey = (1 - b) * ((1 - a) * p[0] + a * p[1]) + b * ((1 - a) * below[0] + a * below[1]);
  return true;
}

void addGradients(Level& level) {
  const int w = level.width;
  for (int i = w + 1; i + w + 1 < w * level.height; ++i) {
    Grey* p = &level.pixels[i];
    p[0][1] = .5F * (p[1][0] - p[-1][0]);
    p[0][2] = .5F * (p[w][0] - p[-w][0]);
  }
}

Level halved(const Level& fine) {
  Level level{fine.width / 2, fine.height / 2, {}};
  for (int y = 0; y < level.height; ++y) {
    for (int x = 0; x < level.width; ++x) {
      const Grey* p = &fine.pixels[2 * y * fine.width + 2 * x];
      const float sum = p[0][0] + p[1][0] + p[fine.width][0] + p[fine.width + 1][0];
      level.pixels.emplace_back(sum / 4, 0, 0);
    }
  }
  return level;
}

void apply(const Vector8& step, Frame& frame) {
  const Eigen::Vector3d turn = step.segment<3>(3);
  Pose move = Pose::Identity();
  if (turn.norm() > 0) move.linear() = Eigen::AngleAxisd(turn.norm(), turn.normalized()).matrix();
  move.translation() = step.head<3>();
  frame.pose = move * frame.pose;
  frame.brightness += step.tail<2>();
}

}  // namespace

int Frame::alive = 0;

Frame::Frame(Shell* record, const float* image, int width, int height)
    : shell(record), pose(record->pose), brightness(record->brightness) {
  ++alive;
  levels.push_back({width, height, {}});
  for (int i = 0; i < width * height; ++i) levels[0].pixels.emplace_back(image[i], 0, 0);
  while (levels.size() < 4) levels.push_back(halved(levels.back()));
  for (Level& level : levels) addGradients(level);
}

System::System(const dsorb::PinholeCamera& camera,
               const dsorb::InitializerOptions& initializer,
               const dsorb::DirectStartOptions& options,
               int& refusals)
    : camera_(camera),
      glue_(new Start{*this}),
      start_(new dsorb::DirectStart<Start>(initializer, camera, options, refusals)) {}

System::~System() = default;

// [add]
void System::addActiveFrame(const float* image) {
  history.emplace_back(new Shell);
  Shell* shell = history.back().get();
  shell->number = static_cast<int>(history.size()) - 1;
  if (window.empty()) {
    const dsorb::ImageView view(image, camera_.width, camera_.height);
    const auto newest = start_->addFrame(*glue_, shell, view);
    started_ = shell->number;
    if (newest) makeKeyframe(std::unique_ptr<Frame>(*newest));
    return;
  }
  std::unique_ptr<Frame> frame(new Frame(shell, image, camera_.width, camera_.height));
  track(*frame);
  const int since = shell->number - started_;
  if ((since <= early && since % 3 == 0) || needsKeyframe(*frame)) makeKeyframe(std::move(frame));
}

void System::makeKeyframe(std::unique_ptr<Frame> frame) {
  window.push_back(std::move(frame));
  optimise();
  init_failed = start_->judge(*glue_, rms).has_value();
  if (init_failed) return;
  marginalise();
  activate();
}
// [/add]

int System::addPoint(const Point& point) {
  points[next_point_] = point;
  return next_point_++;
}

bool System::residual(
    const Point& at, const Frame& to, int level, const int* d, Residual& r) const {
  const dsorb::PinholeCamera camera = camera_.atLevel(level);
  const double scale = 1.0 / (1 << level);
  const double x = (at.u + .5) * scale - .5 + d[0], y = (at.v + .5) * scale - .5 + d[1];
  const Pose T = to.pose * at.host->pose.inverse();
  const Eigen::Vector3d t = T.translation();
  const Eigen::Vector3d p = T.linear() * camera.unproject({x, y}) + at.inverse_depth * t;
  const Eigen::Vector2d seen = camera.project(p);
  Grey here, there;
  if (!(p.z() > .05) || !sample(at.host->levels[level], x, y, here)) return false;
  if (!sample(to.levels[level], seen.x(), seen.y(), there)) return false;
  const Eigen::Vector3d grey = there.cast<double>() * std::exp(to.brightness[0]);
  const double from = std::exp(at.host->brightness[0]) * static_cast<double>(here[0]);
  r.value = grey[0] + to.brightness[1] - from - at.host->brightness[1];
  const double steep = there.tail<2>().squaredNorm() / (kGradient * kGradient);
  r.weight = std::min(1., kHuber / std::abs(r.value)) / (1 + steep);
  const double gx = camera.fx * grey[1] / p.z(), gy = camera.fy * grey[2] / p.z();
  const Eigen::Vector3d slope(gx, gy, -(gx * p.x() + gy * p.y()) / p.z());  // by the place of p
  const Eigen::Vector3d v = at.inverse_depth * slope, w = p.cross(slope);
  const Eigen::Matrix3d back = T.linear().transpose();
  r.J << v, w, grey[0], 1, -back * v, -back * (w - at.inverse_depth * t.cross(slope)), -from, -1;
  r.depth = slope.dot(t);
  return true;
}

/// Adds the residuals of a point to the window's equations, without its depth.
System::Link System::link(const Point& point, double prior, Equations* sums) const {
  Link link{{}, 0, prior, 0, 0};
  link.frames.setZero(8 * static_cast<int>(window.size()));
  int host = 0;
  while (window[host].get() != point.host) ++host;
  for (int k = 0; k < static_cast<int>(window.size()); ++k) {
    if (k == host) continue;
    Eigen::Matrix<double, 17, 17> H = Eigen::Matrix<double, 17, 17>::Zero();
    Eigen::Matrix<double, 17, 1> b = Eigen::Matrix<double, 17, 1>::Zero(), J;
    double energy = 0;
    int pixels = 0;
    Residual r;
    for (const auto& offset : kPattern) {
      if (!residual(point, *window[k], 0, offset, r)) break;
      J << r.J, r.depth;
      H += r.weight * J * J.transpose();
      b += r.weight * r.value * J;
      energy += r.weight * r.value * r.value;
      ++pixels;
    }
    if (pixels < 8 || energy > kOutlier) continue;
    link.gradient += b[16];
    link.information += H(16, 16);
    link.energy += energy;
    ++link.residuals;
    link.frames.segment<8>(8 * k) += H.block<8, 1>(0, 16);
    link.frames.segment<8>(8 * host) += H.block<8, 1>(8, 16);
    if (sums == nullptr) continue;
    const std::array<int, 2> at{8 * k, 8 * host};
    for (int i = 0; i < 2; ++i) {
      sums->b.segment<8>(at[i]) += b.segment<8>(8 * i);
      for (int j = 0; j < 2; ++j) sums->H.block<8, 8>(at[i], at[j]) += H.block<8, 8>(8 * i, 8 * j);
    }
  }
  if (sums == nullptr || link.residuals == 0) return link;
  sums->H -= link.frames * link.frames.transpose() / link.information;
  sums->b -= link.frames * link.gradient / link.information;
  return link;
}

/// Gauss-Newton, the first keyframe at rest; points without a residual are deleted at last.
void System::optimise() {
  const int n = 8 * static_cast<int>(window.size());
  prior_.H.conservativeResizeLike(Eigen::MatrixXd::Zero(n, n));
  prior_.b.conservativeResizeLike(Eigen::VectorXd::Zero(n));
  for (int iteration = 0; iteration < (window.size() < 4 ? 15 : 8); ++iteration) {
    Equations sums = prior_;
    sums.H.diagonal().head<8>().array() += 1e12;
    for (int k = 0; 8 * k < n; ++k) {
      sums.H.diagonal().segment<2>(8 * k + 6) += kBrightness;
      sums.b.segment<2>(8 * k + 6) += kBrightness.cwiseProduct(window[k]->brightness);
    }
    std::map<int, Link> links;
    for (const auto& point : points) {
      links[point.first] = link(point.second, point.second.has_prior ? kDepthPrior : 0, &sums);
    }
    const Eigen::VectorXd scale = (sums.H.diagonal().array() + 10).rsqrt();
    const Eigen::MatrixXd H = scale.asDiagonal() * sums.H * scale.asDiagonal();
    const Eigen::VectorXd step =
        -(scale.asDiagonal() *
          (H + 1e-5 * Eigen::MatrixXd::Identity(n, n)).ldlt().solve(scale.asDiagonal() * sums.b));
    prior_.b += prior_.H * step;
    for (int k = 0; 8 * k < n; ++k) apply(step.segment<8>(8 * k), *window[k]);
    for (auto& point : points) {
      const Link& l = links[point.first];
      if (l.residuals > 0)
        point.second.inverse_depth -= (l.gradient + l.frames.dot(step)) / l.information;
    }
  }
  double energy = 0;
  int residuals = 0;
  for (auto point = points.begin(); point != points.end();) {
    const Link l = link(point->second, point->second.has_prior ? kDepthPrior : 0, nullptr);
    energy += l.energy;
    residuals += l.residuals;
    point->second.information = l.information;
    const bool used = l.residuals > 0 && point->second.inverse_depth > 0;
    point = used ? std::next(point) : points.erase(point);
  }
  rms = std::sqrt(energy / (8 * residuals));  // NaN without any
}

/// Direct alignment from coarse to fine, from the motion between both records before.
void System::track(Frame& frame) {
  const Shell &last = *history.end()[-2], &before = *history.end()[-3];
  frame.pose = last.valid && before.valid ? last.pose * before.pose.inverse() * last.pose
                                          : window.back()->pose;
  frame.brightness = last.brightness;
  for (int level = 3; level >= 0; --level) {
    for (int iteration = 0; iteration < 10; ++iteration) {
      Eigen::Matrix<double, 8, 8> H = Eigen::Matrix<double, 8, 8>::Zero();
      Vector8 b = Vector8::Zero();
      Residual r;
      for (const auto& point : points) {
        if (!residual(point.second, frame, level, kPattern[4], r)) continue;
        H += r.weight * r.J.head<8>() * r.J.head<8>().transpose();
        b += r.weight * r.value * r.J.head<8>();
      }
      H.diagonal().tail<2>() += kBrightness / 8;
      b.tail<2>() += kBrightness.cwiseProduct(frame.brightness) / 8;
      H.diagonal() *= 1 + 1e-4;
      const Vector8 step = -H.ldlt().solve(b);
      apply(step, frame);
      if (step.norm() < 1e-6) break;
    }
  }
  frame.shell->valid = true;
}

/// Pixel and inverse depth of a point in a frame.
std::optional<Eigen::Vector3d> System::seen(const Point& point, const Frame& frame) const {
  const Eigen::Vector3d ray = camera_.unproject({point.u, point.v});
  const Eigen::Vector3d p = frame.pose * point.host->pose.inverse() * (ray / point.inverse_depth);
  const Eigen::Vector2d pixel = camera_.project(p);
  if (!(p.z() > 0) || !camera_.contains(pixel, 4)) return std::nullopt;
  return Eigen::Vector3d(pixel.x(), pixel.y(), 1 / p.z());
}

bool System::needsKeyframe(const Frame& frame) const {
  double flow = 0, count = .1;
  for (const auto& point : points) {
    const auto then = seen(point.second, *window.back()), now = seen(point.second, frame);
    if (then && now) flow += (*now - *then).head<2>().norm(), ++count;
  }
  return flow / count > kKeyframeFlow * (camera_.width + camera_.height);
}

/// New points at the strongest gradients where the newest keyframe sees none, if the keyframes
/// agree on a depth near that of the nearest point.
void System::activate() {
  const Level& level = window.back()->levels[0];
  std::vector<Eigen::Vector3d> known;
  for (const auto& point : points) {
    if (const auto pixel = seen(point.second, *window.back())) known.push_back(*pixel);
  }
  const int across = (level.width - 16) / kCell, cells = across * ((level.height - 16) / kCell);
  for (int cell = 0; cell < cells; ++cell) {
    Point point{window.back().get(), 0, 0, 1};
    float strongest = 10 * 10;
    for (int i = 0; i < kCell * kCell; ++i) {
      const int u = 8 + cell % across * kCell + i % kCell;
      const int v = 8 + cell / across * kCell + i / kCell;
      const float squared = level.pixels[v * level.width + u].tail<2>().squaredNorm();
      if (squared > strongest) strongest = squared, point.u = u, point.v = v;
    }
    double nearest = std::numeric_limits<double>::max(), step = 1;
    for (const Eigen::Vector3d& p : known) {
      const double distance = std::hypot(p.x() - point.u, p.y() - point.v);
      if (distance < nearest) nearest = distance, point.inverse_depth = p.z();
    }
    if (point.u == 0 || nearest < kCell / 2) continue;
    Link l{{}, 0, 0, 0, 0};
    for (int iteration = 0; iteration < 6 && point.inverse_depth > 0; ++iteration) {
      l = link(point, 1, nullptr);
      point.inverse_depth -= step = l.gradient / l.information;
    }
    const bool sure = l.information > 400 && std::abs(step) < .01 * point.inverse_depth;
    if (sure && l.residuals > 1 && l.energy < 8 * 64 * l.residuals) addPoint(point);
  }
}

/// Points that the newest keyframe does not see and a keyframe too many go into the prior.
void System::marginalise() {
  const int n = 8 * static_cast<int>(window.size());
  const bool full = window.size() > kMaxKeyframes;
  Equations gone{Eigen::MatrixXd::Zero(n, n), Eigen::VectorXd::Zero(n)};
  for (auto point = points.begin(); point != points.end();) {
    const bool leaves = full && point->second.host == window[1].get();
    const bool stays = !leaves && seen(point->second, *window.back());
    if (!stays) link(point->second, point->second.has_prior ? 600 * 600 * kDepthPrior : 0, &gone);
    point = stays ? std::next(point) : points.erase(point);
  }
  prior_.H += .25 * gone.H;
  prior_.b += .25 * gone.b;
  if (!full) return;
  std::vector<int> outer, inner;
  for (int i = 0; i < n; ++i) (i / 8 == 1 ? inner : outer).push_back(i);
  const Eigen::MatrixXd corner = prior_.H(inner, inner) + 1e-3 * Eigen::MatrixXd::Identity(8, 8);
  const Eigen::MatrixXd across = prior_.H(inner, outer);
  const Eigen::MatrixXd factor = corner.ldlt().solve(across).transpose();
  prior_ = {prior_.H(outer, outer) - factor * across, prior_.b(outer) - factor * prior_.b(inner)};
  window.erase(window.begin() + 1);
}

}  // namespace fork
