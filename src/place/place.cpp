// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/place/place.h"

#include "base/parallel.h"
#include "base/timed.h"
#include "place/binary_index.h"
#include "place/joining.h"
#include "place/keyframe_store.h"
#include "place/loops.h"
#include "place/map_file.h"
#include "place/recent_views.h"
#include "place/recognition.h"

#include <algorithm>
#include <cmath>
#include <deque>
#include <map>
#include <optional>
#include <set>
#include <stdexcept>
#include <utility>
#include <vector>

namespace dsorb {
namespace {

constexpr std::size_t kAskedCandidates = 3;  // that a frame is compared with
constexpr double kPatchSlope = 0.02;         // of a depth, that pixels beside the corner differ
constexpr std::size_t kLoopGap = 10;         // keyframes between two ends of a loop at least
constexpr std::size_t kLoopSpacing = 3;  // keyframes from one query to the next; links see as many
constexpr std::size_t kLosses = 4;       // whose views are remembered, the newest
constexpr int kSeenBy = 2;  // keyframes that agree where segments lie, as SIFT sees them
// Probability that one of these sees another place: 1 of 168 views of rooms with the same walls
// did.
constexpr double kWrongView = 0.006;

}  // namespace

class Place::Impl {
 public:
  /// The views before and after a loss.
  struct Loss {
    place::RecentViews before;
    place::RecentViews after;
  };

  explicit Impl(const PlaceOptions& chosen) : options(chosen), arena(chosen.num_threads) {}

  void noteStart(const InitStep& step, int segment) {
    if (!step.result) return;
    for (const PosedFrame& posed : step.result->frames) {
      if (posed.T_cam_ref) start_frames[posed.frame->id()] = posed.frame;
    }
    if (step.result->metric && segments.count(segment) == 0) metric.insert(segment);
    ++stretch;
  }

  void remember(FrameId id, const Frame& frame, int segment) {
    if (recent.segment().value_or(segment) != segment) {
      losses.push_back({std::exchange(recent, {}), {}});
      if (losses.size() > kLosses) losses.pop_front();
    }
    const std::optional<place::RecentView> view = place::viewOf(id, frame);
    if (!view) return;
    recent.add(*view);
    if (losses.empty()) return;
    place::RecentViews& after = losses.back().after;
    if (after.size() < place::RecentViews::kViews) after.add(*view);
  }

  void noteFrame(const FrameEstimate& estimate) {
    start_frames.clear();
    if (!estimate.is_keyframe || positions.count(estimate.frame->id()) > 0) return;
    const FrameId id = estimate.frame->id();
    timed(report.adding_seconds, [&] { views[id] = place::describeView(*estimate.frame); });
    remember(id, *estimate.frame, estimate.segment);
    const auto told = early.find(id);
    if (told == early.end()) return;
    enter(told->second);
    early.erase(told);
  }

  void noteKeyframe(const KeyframeSnapshot& keyframe) {
    tellViews(keyframe);
    const auto known = positions.find(keyframe.id);
    if (known != positions.end()) {
      store.update(known->second, keyframe);
      return;
    }
    const auto start = start_frames.find(keyframe.id);
    if (start != start_frames.end()) {
      timed(report.adding_seconds,
            [&] { views[keyframe.id] = place::describeView(*start->second); });
      remember(keyframe.id, *start->second, keyframe.segment);
      tellViews(keyframe);
    }
    if (views.count(keyframe.id) > 0) {
      enter(keyframe);
      return;
    }
    early[keyframe.id] = keyframe;
    early[keyframe.id].points.clear();
  }

  void tellViews(const KeyframeSnapshot& keyframe) {
    recent.tell(keyframe);
    for (Loss& loss : losses) {
      loss.before.tell(keyframe);
      loss.after.tell(keyframe);
    }
  }

  void enter(const KeyframeSnapshot& keyframe) {
    timed(report.adding_seconds, [&] {
      const auto view = views.find(keyframe.id);
      positions[keyframe.id] =
          arena.run([&] { return store.add(keyframe, std::move(view->second), stretch); });
      views.erase(view);
      index.add(store[store.size() - 1].view.descriptors);
      segments.insert(keyframe.segment);
    });
  }

  void retire(const KeyframeSnapshot& keyframe) {
    noteKeyframe(keyframe);
    const auto known = positions.find(keyframe.id);
    if (known == positions.end()) return;
    timed(report.adding_seconds, [&] { store.triangulateAround(known->second); });
  }

  int load(const std::string& file) {
    std::map<int, int> numbers;
    std::vector<place::StoredKeyframe> keyframes = place::readMap(file);
    for (place::StoredKeyframe& keyframe : keyframes) {
      const int next = first_segment + static_cast<int>(numbers.size());
      keyframe.segment = numbers.try_emplace(keyframe.segment, next).first->second;
      keyframe.stretch += first_stretch;
      stretch = std::max(stretch, keyframe.stretch + 1);
      segments.insert(keyframe.segment);
      index.add(keyframe.view.descriptors);
    }
    store.append(std::move(keyframes));
    first_segment += static_cast<int>(numbers.size());
    first_stretch = stretch;
    return first_segment;
  }

  std::optional<RecognizedPlace> recognizeNow(const Frame& frame, const PinholeCamera& camera) {
    if (store.size() == 0) return std::nullopt;
    ++report.asked;
    return timed(report.asking_seconds,
                 [&] { return arena.run([&] { return placeOf(frame, camera); }); });
  }

  /// ORB asks all keyframes, which is fast; where it finds none, SIFT asks the newest.
  [[nodiscard]] std::optional<RecognizedPlace> placeOf(const Frame& frame,
                                                       const PinholeCamera& camera) {
    const place::View view = place::describeView(frame);
    std::optional<place::Recognition> best;
    for (const auto& candidate :
         index.query(view.descriptors, kAskedCandidates, [](std::size_t) { return true; })) {
      auto found = place::recognize(store, {&view, camera, 0}, candidate.image);
      if (found && (!best || found->points.size() > best->points.size())) best = std::move(found);
    }
    if (!best || !(place::wrongProbability(best->evidence) <= options.max_wrong_probability)) {
      return recent.find(frame, camera);
    }
    const place::StoredKeyframe& keyframe = store[best->keyframe];
    RecognizedPlace place;
    place.segment = keyframe.segment;
    place.T_world_cam = best->T_view_world.inverse();
    place.covariance = best->covariance;
    if (keyframe.stretch >= first_stretch) {
      place.keyframe = keyframe.id;
      place.T_cam_keyframe = best->T_view_world * keyframe.T_world_cam;
    }
    for (std::size_t i = 0; i < best->points.size(); ++i) {
      const place::StoredPoint& point = best->points[i];
      const double z = (best->T_view_world * point.position).z();
      const double sigma = std::hypot(point.uncertainty.norm(), kPatchSlope * z);
      place::addDepth(view.pixels[best->features[i]], z, sigma, place);
    }
    return place;
  }

  void finish() {
    for (int s = first_stretch; s <= stretch; ++s) store.triangulate(s);
    if (segments.size() > 1) join();
    if (options.loops && canCloseLoops()) closeLoops();
    if (observers.empty() || positions.empty()) return;
    const std::vector<MapTrack> tracks = store.tracks(first_stretch);
    for (OdometryObserver* observer : observers) observer->onTracks(tracks);
  }

  /// Links of every so many keyframes to those that `wanted` admits.
  template <typename Wanted>
  [[nodiscard]] std::vector<place::Link> sureLinks(std::size_t every, const Wanted& wanted) const {
    std::vector<std::size_t> queries;
    for (std::size_t i = 0; i < store.size(); i += every) queries.push_back(i);
    std::vector<place::Link> links = place::findLinks(store, index, queries, wanted);
    links.erase(std::remove_if(links.begin(),
                               links.end(),
                               [&](const place::Link& link) {
                                 return !(link.wrong_probability <= options.max_wrong_probability);
                               }),
                links.end());
    return links;
  }

  /// The segment whose world stays of two: one in metres, the earlier one of equals.
  [[nodiscard]] int stayingOf(int a, int b) const {
    if (std::min(a, b) < first_segment) return std::min(a, b);
    if (metric.count(a) != metric.count(b)) return metric.count(a) > 0 ? a : b;
    return std::min(a, b);
  }

  /// ORB asks all segments; those before and after a loss that it does not join are asked by SIFT.
  [[nodiscard]] std::vector<place::Join> allJoins() {
    std::vector<place::Join> joins =
        place::joinsOf(store, sureLinks(1, [&](std::size_t query, std::size_t candidate) {
                         return store[query].segment != store[candidate].segment;
                       }));
    for (Loss& loss : losses) {
      const std::optional<int> a = loss.before.segment();
      const std::optional<int> b = loss.after.segment();
      const bool joined = std::any_of(joins.begin(), joins.end(), [&](const place::Join& join) {
        return (join.into == a && join.segment == b) || (join.into == b && join.segment == a);
      });
      if (joined) continue;
      for (place::Join join : place::joinsOf(store, loss.before.linksTo(loss.after, positions))) {
        if (join.keyframes < kSeenBy) continue;
        join.wrong_probability = std::pow(kWrongView, join.keyframes);
        if (join.wrong_probability <= options.max_wrong_probability) joins.push_back(join);
      }
    }
    return joins;
  }

  void join() {
    std::map<int, std::pair<int, Similarity>> root;  // of a segment, and its world from that one's
    for (const int segment : segments) root[segment] = {segment, {}};
    for (const place::Join& join : allJoins()) {
      const auto [root_a, S_root_a] = root[join.into];
      const auto [root_b, S_root_b] = root[join.segment];
      if (root_a == root_b) continue;
      const int stays = stayingOf(root_a, root_b);
      Similarity S_stays_moved = S_root_a * join.S_into_segment * S_root_b.inverse();
      Matrix7d adjoint = S_root_a.adjoint();
      if (stays == root_b) {
        S_stays_moved = S_stays_moved.inverse();
        adjoint = S_stays_moved.adjoint() * adjoint;
      }
      const int moved = stays == root_a ? root_b : root_a;
      for (auto& [segment, place] : root) {
        if (place.first == moved) place = {stays, S_stays_moved * place.second};
      }
      store.move(moved, stays, S_stays_moved);
      segments.erase(moved);
      ++report.joined;
      const SegmentsJoined told{moved,
                                stays,
                                S_stays_moved,
                                adjoint * join.covariance * adjoint.transpose(),
                                join.keyframes,
                                join.matches,
                                join.wrong_probability};
      for (OdometryObserver* observer : observers) observer->onSegmentsJoined(told);
    }
  }

  void closeLoops() {
    const auto links = sureLinks(kLoopSpacing, [&](std::size_t query, std::size_t candidate) {
      if (store[query].segment != store[candidate].segment || candidate >= query) return false;
      return store[query].stretch != store[candidate].stretch ||
             (query - candidate > kLoopGap && !store.shareTracks(query, candidate));
    });
    for (const int segment : segments) {
      std::vector<place::Link> inside;
      for (const place::Link& link : links) {
        if (store[link.from].segment == segment) inside.push_back(link);
      }
      const std::vector<Similarity> moves =
          place::closeLoops(store, segment, inside, options.num_threads);
      if (moves.empty()) continue;
      LoopsClosed closed{segment, static_cast<int>(inside.size()), {}};
      const std::vector<std::size_t> members = store.inSegment(segment);
      for (std::size_t k = 0; k < members.size(); ++k) {
        if (store[members[k]].stretch >= first_stretch) {
          closed.moved.push_back({store[members[k]].id, moves[k]});
        }
        store.move(members[k], moves[k]);
      }
      report.loops += closed.loops;
      for (OdometryObserver* observer : observers) observer->onLoopsClosed(closed);
    }
  }

  PlaceOptions options;
  TaskArena arena;
  place::KeyframeStore store;
  place::BinaryIndex index;
  std::map<FrameId, std::size_t> positions;   // in the store
  std::map<FrameId, FramePtr> start_frames;   // of the newest start, until it stands
  std::map<FrameId, place::View> views;       // of frames that become keyframes
  std::map<FrameId, KeyframeSnapshot> early;  // told before their frames
  place::RecentViews recent;
  std::deque<Loss> losses;
  std::set<int> segments;
  std::set<int> metric;  // segments told in metres
  std::vector<OdometryObserver*> observers;
  PlaceReport report;
  int first_segment = 0;  // of the run: those below are of a loaded map
  int first_stretch = 0;
  int stretch = 0;  // the newest one
};

Place::Place(const PlaceOptions& options) : impl_(std::make_unique<Impl>(options)) {}
Place::~Place() = default;

void Place::addObserver(OdometryObserver* observer) {
  if (observer == nullptr) throw std::invalid_argument("observer is null");
  impl_->observers.push_back(observer);
}

void Place::onInitStep(const InitStep& step, const Frame& /*frame*/, int segment) {
  impl_->noteStart(step, segment);
}

void Place::onFrame(const FrameEstimate& estimate) {
  impl_->noteFrame(estimate);
}

void Place::onKeyframe(const KeyframeSnapshot& keyframe) {
  impl_->noteKeyframe(keyframe);
}

void Place::onKeyframeRetired(const KeyframeSnapshot& keyframe) {
  impl_->retire(keyframe);
}

int Place::load(const std::string& file) {
  return impl_->load(file);
}

Recognizer Place::recognizer(const PinholeCamera& camera) {
  return [this, camera](const Frame& frame) { return impl_->recognizeNow(frame, camera); };
}

void Place::save(const std::string& file) const {
  place::writeMap(file, impl_->store.keyframes());
}

void Place::onStartRefused(const StartRefusal& refusal) {
  impl_->start_frames.clear();
  impl_->metric.erase(refusal.segment);
}

PlaceReport Place::finish() {
  Impl& my = *impl_;
  timed(my.report.finish_seconds, [&] { my.arena.run([&] { my.finish(); }); });
  my.report.keyframes = static_cast<int>(my.store.size());
  my.report.bytes = my.store.bytes() + my.index.bytes();
  return my.report;
}

PlaceReport mergeMaps(const std::vector<std::string>& maps,
                      const std::string& into,
                      const PlaceOptions& options) {
  Place place(options);
  for (const std::string& map : maps) place.load(map);
  const PlaceReport report = place.finish();
  place.save(into);
  return report;
}

}  // namespace dsorb
